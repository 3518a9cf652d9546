"""``gimpmd replay``: play one side of a recorded run back, and run the other one."""

from __future__ import annotations

import math
import signal
from typing import Annotated

import typer
from rich.console import Console

from gimpmd_deploy.cli.options import Force, Out, RunPath, Side, standard_output
from gimpmd_deploy.launch.progress import Display, Pace
from gimpmd_deploy.launch.replay import Wanted, default_folder, make_ready
from gimpmd_deploy.launch.run import start
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.errors import STOPPED, GimpmdError, ProtocolError
from gimpmd_schemas.mechanics.units import UNITS
from gimpmd_schemas.wire.fields import ZONE_FIELDS
from gimpmd_schemas.wire.replay import Compared, Difference, load_result


def replay(
    run: RunPath,
    side: Annotated[Side, typer.Option("--side", help="The side that is played back.")],
    command: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[-- COMMAND]",
            help="Command of the side that runs, mpiexec included; default: that of the run.",
            show_default=False,
        ),
    ] = None,
    out: Out = None,
    force: Force = False,
    steps: Annotated[
        int | None, typer.Option("--steps", min=1, help="End the replay at this step.")
    ] = None,
    tolerance: Annotated[
        float,
        typer.Option(
            "--tolerance",
            min=0.0,
            help="Largest difference that is accepted, relative to the largest value of the field"
            " in the recording; 0: all bits must be the same.",
        ),
    ] = 0.0,
    go_on: Annotated[
        bool, typer.Option("--go-on", help="Go on after a difference that is not accepted.")
    ] = False,
    by_hand: Annotated[
        bool,
        typer.Option(
            "--by-hand",
            help="Print the command of the side that runs, and wait until you have started it, for"
            " example in a debugger.",
        ),
    ] = False,
) -> None:
    """Play one side of a recorded run back, run the other one, and compare what it sends."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)  # a run outlives its terminal
    console = standard_output()
    role: Role = side.value
    wanted = Wanted(role, steps, tolerance, go_on, by_hand, command or ())
    ready = make_ready(run, out or default_folder(run, role), wanted, force)
    for note in ready.notes:
        console.print(f"warning: {note}", style="yellow", markup=False)
    console.print(f"{ready.plan.name}: {ready.plan.steps} steps, {role} is played back")
    if ready.command:
        console.print(f"start {wanted.live} in another terminal:")
        for line in ready.command:
            typer.echo(f"  {line}")
    try:
        with Display(console, Pace.of(ready.plan, 0)) as display:
            # a process in a debugger is silent for as long as its user thinks
            outcome = start(ready.folder, ready.services, ready.lock, display, False, math.inf)
    finally:
        found = load_result(ready.folder)
        _print(found, wanted, ready.plan, console)
    console.print(f"results in {ready.folder}")
    if found.first is not None:
        raise ProtocolError(f"{wanted.live} does not send what it has sent in {run}")
    if outcome.stopped:
        raise typer.Exit(STOPPED)
    if not found.payloads:
        raise GimpmdError(f"{wanted.live} has sent nothing that {role} takes")


def _print(found: Compared, wanted: Wanted, plan: Plan, console: Console) -> None:
    """Say what was compared, and how far it is from the recording."""
    count = f"{found.payloads} payload{'' if found.payloads == 1 else 's'} of {wanted.live}"
    if not found.largest:
        same = "same bits as in the recording" if found.payloads else "nothing was compared"
        console.print(f"{count}: {same}")
        return
    console.print(f"{count}: {found.differing} differ by more than is accepted")
    if found.first is not None:
        console.print(f"first difference: {_words(found.first, plan)}", style="red", markup=False)
    for one in found.largest.values():
        console.print(f"largest difference: {_words(one, plan)}", markup=False)


def _words(one: Difference, plan: Plan) -> str:
    unit = next(field for field in ZONE_FIELDS if field.name == one.field).unit_in(
        UNITS[plan.units]
    )
    nodes = f"{one.nodes} node{'' if one.nodes == 1 else 's'}"
    return f"step {one.step}, {one.rank}, {one.field} at {nodes}: up to {one.largest:.3g} {unit}"

"""``gimpmd run`` and ``gimpmd up``: run a case; ``gimpmd resume``: go on with a run."""

from __future__ import annotations

import signal
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from gimpmd_deploy.cli.options import (
    CasePath,
    Force,
    Only,
    Out,
    RanksGimp,
    RanksMd,
    RunPath,
    Side,
    standard_output,
)
from gimpmd_deploy.launch.asking_continuum import lack_of_memory
from gimpmd_deploy.launch.compose import describe, start_first
from gimpmd_deploy.launch.estimate import estimate
from gimpmd_deploy.launch.merged_logs import MergedLogs
from gimpmd_deploy.launch.modes import said_of
from gimpmd_deploy.launch.progress import Display, Pace
from gimpmd_deploy.launch.reading import read_case
from gimpmd_deploy.launch.resume import make_ready_again
from gimpmd_deploy.launch.run import ReadyRun, default_folder, make_ready, start
from gimpmd_deploy.launch.same_case import check_same_case
from gimpmd_deploy.launch.services import DEADLINE, RunServices
from gimpmd_deploy.launch.supervise import Outcome, Watcher
from gimpmd_deploy.wording import quantity
from gimpmd_schemas.case.cautions import cautions
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.errors import STOPPED, BackendError, DefectError, InputError
from gimpmd_schemas.mechanics.units import UNITS
from gimpmd_schemas.resolve import fill_in
from gimpmd_schemas.run_lock import RunLock

Figures = Annotated[bool, typer.Option(help="Draw the figures at the end.")]
Restart = Annotated[
    bool, typer.Option(help="Go on from the last checkpoint when a process has died.")
]
Deadline = Annotated[
    float,
    typer.Option(
        min=1.0,
        metavar="SECONDS",
        help="Without a coupling step for as long, the coupler says whom it waits for; it ends the "
        "run after ten times as long, or sixty times at the start.",
    ),
]


@dataclass(frozen=True)
class Wishes:
    """How a run is watched.

    Attributes
    ----------
    restart : go on from the last checkpoint when a process has died.
    deadline : seconds without a coupling step after which the coupler says whom it waits for.
    show_logs : show the logs of all services.
    figures : draw the figures at the end.
    """

    restart: bool
    deadline: float
    show_logs: bool = False
    figures: bool = True


def run(
    case: CasePath,
    only: Only = None,
    out: Out = None,
    force: Force = False,
    ranks_md: RanksMd = None,
    ranks_gimp: RanksGimp = None,
    restart: Restart = True,
    deadline: Deadline = DEADLINE,
    figures: Figures = True,
    until: Annotated[
        float | None,
        typer.Option(
            metavar="TIME",
            help="Another end time; an earlier run of the case in the run folder goes on until "
            "then.",
        ),
    ] = None,
) -> None:
    """Run a case and show its progress; then draw its figures and print its report."""
    wishes = Wishes(restart, deadline, figures=figures)
    afresh = until is None or force
    earlier = None if afresh else _earlier_run(case, only, out, ranks_md, ranks_gimp)
    if earlier is None:
        _run(case, only, out, force, ranks_md, ranks_gimp, wishes, until=until)
    else:
        _resume(earlier, until, ranks_md, ranks_gimp, wishes)


def up(
    case: CasePath,
    only: Only = None,
    out: Out = None,
    force: Force = False,
    ranks_md: RanksMd = None,
    ranks_gimp: RanksGimp = None,
    restart: Restart = True,
    deadline: Deadline = DEADLINE,
    file: Annotated[
        Path | None,
        typer.Option(
            metavar="COMPOSE.yaml",
            help="Take the commands of the services from a compose file, and start them without "
            "containers.",
        ),
    ] = None,
) -> None:
    """Run a case and show the logs of all services together; Ctrl-C stops them all."""
    wishes = Wishes(restart, deadline, show_logs=True)
    _run(case, only, out, force, ranks_md, ranks_gimp, wishes, file)


def resume(
    folder: RunPath,
    until: Annotated[float | None, typer.Option(help="New end time.", metavar="TIME")] = None,
    ranks_md: RanksMd = None,
    ranks_gimp: RanksGimp = None,
    restart: Restart = True,
    deadline: Deadline = DEADLINE,
    figures: Figures = True,
) -> None:
    """Go on with a run from its last checkpoint, or extend one that has ended."""
    _resume(folder, until, ranks_md, ranks_gimp, Wishes(restart, deadline, figures=figures))


def _earlier_run(
    path: Path,
    only: Side | None,
    out: Path | None,
    ranks_md: int | None,
    ranks_gimp: int | None,
) -> Path | None:
    """Folder of an earlier run of a case; None if there is none."""
    case = read_case(path, only.value if only else None, ranks_md, ranks_gimp)
    folder = out or default_folder(case)
    if not (folder / "plan.yaml").is_file():
        return None
    check_same_case(case, path, folder)
    return folder


def _resume(
    folder: Path, until: float | None, ranks_md: int | None, ranks_gimp: int | None, wishes: Wishes
) -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)  # a run outlives its terminal
    console = standard_output()
    ready = make_ready_again(folder, until, ranks_md, ranks_gimp)
    for note in ready.notes:
        console.print(f"warning: {note}", style="yellow", markup=False)
    plan, start_ = ready.plan, ready.start
    console.print(
        f"{plan.name}: goes on at step {start_.step} of {plan.steps}, t = {start_.time:g}"
    )
    _carry_out(plan, folder, ready.services, ready.lock, Pace.of(plan, 0), console, wishes)


def _run(
    path: Path,
    only: Side | None,
    out: Path | None,
    force: bool,
    ranks_md: int | None,
    ranks_gimp: int | None,
    wishes: Wishes,
    file: Path | None = None,
    until: float | None = None,
) -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)  # a run outlives its terminal
    console = standard_output()
    case = read_case(path, only.value if only else None, ranks_md, ranks_gimp, until)
    folder = out or default_folder(case)
    described = describe(file, case, path.parent, folder) if file is not None else None
    ready = make_ready(case, path, folder, force)
    if described is not None:
        ready = start_first(ready, described)
    console.print(_headline(ready))
    if ready.modes is not None:
        console.print(f"modes: {said_of(ready.modes)}")
    lack = lack_of_memory(ready.case, ready.correction)
    for caution in (*cautions(ready.plan), *lack, *ready.probe.notes):
        console.print(f"warning: {caution}", style="yellow", markup=False)
    plan, pace = ready.plan, Pace.of(ready.plan, ready.probe.atoms)
    _carry_out(plan, folder, ready.services, ready.lock, pace, console, wishes)


def _carry_out(
    plan: Plan,
    folder: Path,
    services: RunServices,
    lock: RunLock,
    pace: Pace,
    console: Console,
    wishes: Wishes,
) -> None:
    """Run to the end, say how it ended, and show the results."""
    with Display(console, pace) as display:
        watcher: Watcher = display
        if wishes.show_logs:
            logs = {one.name: one.log for one in (services.coupler, *services.sides(""))}
            watcher = MergedLogs(console, logs, display)
        outcome = start(folder, services, lock, watcher, wishes.restart, wishes.deadline)
    _print_outcome(outcome, plan, console)
    by_user = outcome.stopped and not outcome.defect
    _show_results(folder, console, draw=wishes.figures and not by_user)
    if outcome.defect:
        raise DefectError(
            f"a monitor found that the results are not reliable, so the run was stopped at t = "
            f"{outcome.time:.6g} (coupling.on_defect: stop); the results until then are in "
            f"{folder}"
        )
    if by_user:
        raise typer.Exit(STOPPED)


def _headline(ready: ReadyRun) -> str:
    plan = ready.plan
    cost = estimate(fill_in(ready.case, ready.probe, ready.folder), ready.probe)
    parts = [
        f"{count:,} {what}"
        for count, what in ((cost.atoms, "atoms"), (cost.points, "material points"))
        if count
    ]
    parts.append(f"{plan.steps} steps of {plan.step:g} {UNITS[plan.units].time}")
    if ready.correction is not None:
        memory = quantity(ready.correction.memory)
        parts.append(f"a correction of about {memory}B in each continuum rank")
    return f"{plan.name}: {', '.join(parts)}"


def _print_outcome(outcome: Outcome, plan: Plan, console: Console) -> None:
    reached = f"step {outcome.step} of {plan.steps}, t = {outcome.time:.6g}"
    if outcome.stopped:
        forced = " (processes were killed: the last steps may not be recorded)"
        console.print(f"stopped at {reached}{forced if outcome.forced else ''}")
    else:
        console.print(f"finished at {reached}")


def _show_results(folder: Path, console: Console, draw: bool) -> None:
    """Print the report, and draw the figures unless the user stopped the run."""
    from gimpmd_deploy.figures.registry import draw_all
    from gimpmd_deploy.results.report import make_report
    from gimpmd_deploy.results.run import Run
    from gimpmd_deploy.results.tables import print_report

    results = Run(folder)
    console.print(f"results in {folder}")
    if draw:
        try:
            drawn = draw_all(results)
            console.print(f"{len(drawn)} figures in {folder / 'figures'}")
        except (BackendError, InputError) as error:  # no output, or no matplotlib
            console.print(f"no figures: {error}", markup=False)
    else:
        console.print(f"to draw the figures: gimpmd plot {folder}")
    try:
        print_report(make_report(results), results.plan.units, console)
    except InputError as error:  # the run ended before its first step was recorded
        console.print(f"no report: {error}", markup=False)

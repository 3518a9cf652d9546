"""``gimpmd validate``: check a case, estimate its cost, and draw its set-up."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.console import Console
from rich.table import Table

from gimpmd_deploy.cli.options import (
    CasePath,
    Json,
    Only,
    RanksGimp,
    RanksMd,
    print_json,
    standard_output,
)
from gimpmd_deploy.launch.asking_continuum import ask_correction, check_mesh, lack_of_memory
from gimpmd_deploy.launch.estimate import Estimate, estimate
from gimpmd_deploy.launch.modes import look_at_modes, said_of
from gimpmd_deploy.launch.reading import read_case
from gimpmd_deploy.launch.run import ask
from gimpmd_deploy.wording import clock, quantity
from gimpmd_schemas.case.cautions import early_cautions
from gimpmd_schemas.case.derive.zones import zones as zones_of
from gimpmd_schemas.case.form import AT_PLANES, Case
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_schemas.mechanics.units import UNITS
from gimpmd_schemas.resolve import fill_in, resolve
from gimpmd_schemas.wire.answers import CorrectionSize


def validate(
    case: CasePath,
    only: Only = None,
    probe: Annotated[
        bool, typer.Option("--probe", help="Let LAMMPS create the atoms and measure the material.")
    ] = False,
    picture: Annotated[
        Path | None, typer.Option("--picture", metavar="FILE", help="Draw the set-up.")
    ] = None,
    ranks_md: RanksMd = None,
    ranks_gimp: RanksGimp = None,
    as_json: Json = False,
) -> None:
    """Check a case without running it, estimate its cost, and draw its set-up."""
    checked = read_case(case, only.value if only else None, ranks_md, ranks_gimp)
    answer = ask(checked, case) if probe else None
    if answer is not None:
        resolve(checked, answer, case)  # checks what only LAMMPS knows
        checked = fill_in(checked, answer, case)
    check_mesh(checked, case)
    correction = ask_correction(checked, case)
    cost = estimate(checked, answer, correction, look_at_modes(checked, case))
    if picture is not None:
        from gimpmd_deploy.figures.set_up import draw_set_up

        _check_picture(picture)
        draw_set_up(checked, picture)
    if as_json:
        print_json(cost)
    else:
        _print_estimate(case, checked, cost, standard_output())
        cautions = (*early_cautions(checked), *lack_of_memory(checked, correction))
        for note in (*cautions, *(answer.notes if answer else ())):
            standard_output().print(f"warning: {note}", style="yellow", markup=False)


def _check_picture(path: Path) -> None:
    if not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
        problem = Problem(
            "--picture",
            None,
            f"cannot write in {path.parent}",
            "create the folder, or choose another",
        )
        raise InputError(str(path), [problem])


def _print_estimate(path: Path, case: Case, cost: Estimate, console: Console) -> None:
    units = UNITS[case.units]
    unknown = "only LAMMPS knows; --probe asks it"

    def show(value: object | None, text: str) -> str:
        return unknown if value is None else text

    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim")
    table.add_row("case", f"{path} is valid")
    table.add_row("sides", " and ".join(case.roles()))
    table.add_row("atoms", show(cost.atoms, f"{cost.atoms:,}" if cost.atoms is not None else ""))
    for k, level in enumerate(cost.levels):
        text = f"{level.cells:,} cells of {level.cell:g} {units.length}, {level.points:,} points"
        if level.step is not None:
            text += f", step {level.step:.4g} {units.time}"
        table.add_row(f"level {k}", text)
    table.add_row("material points", f"{cost.points:,}")
    table.add_row("grid nodes", f"{cost.nodes:,}")
    if case.only is None:
        table.add_row("coupling", _coupling(case))
    if cost.step is not None:
        text = f"{cost.steps} of {cost.step:g} {units.time}"
        if cost.md_steps is not None:
            text += f", {cost.md_steps} MD steps each"
        table.add_row("steps", text)
    else:
        table.add_row("steps", unknown)
    if case.only != "md":
        table.add_row("CFL number", show(cost.cfl, f"{cost.cfl:.2f}" if cost.cfl else ""))
    if cost.correction is not None:
        table.add_row("correction", _correction(cost.correction))
    if cost.modes is not None:
        table.add_row("modes", said_of(cost.modes))
    table.add_row("memory", f"about {quantity(cost.memory)}B")
    if cost.seconds is not None:
        table.add_row("wall time", f"about {clock(cost.seconds)} on this machine")
    console.print(table)


def _correction(size: CorrectionSize) -> str:
    return f"{size.equations:,} equations, about {quantity(size.memory)}B in each continuum rank"


def _coupling(case: Case) -> str:
    """The coupling scheme, and where it acts."""
    zones, unit = zones_of(case), UNITS[case.units].length
    scheme = case.coupling.scheme
    if scheme not in AT_PLANES:
        return (
            f"{scheme}: outer {zones.outer:g}, incommunicado {zones.incommunicado:g},"
            f" inner {zones.inner:g}, filter {zones.filter:g} {unit}"
        )
    if case.coupling.planes is None:
        return (
            f"{scheme}: at planes between layers of atoms, which only LAMMPS knows; --probe asks it"
        )
    found = [
        ", ".join(
            f"{face} {place:g}"
            for face, place in msgspec.structs.asdict(planes).items()
            if place is not None
        )
        for planes in case.coupling.each_planes().values()
    ]
    return f"{scheme}: planes {'; '.join(found)} {unit}"

"""``gimpmd verify interface``: measure which waves cross the interface of a case."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.console import Console

from gimpmd_deploy.cli.errors import print_error
from gimpmd_deploy.cli.options import CasePath, Force, Json, print_json, standard_output
from gimpmd_deploy.launch.reading import read_case
from gimpmd_schemas.errors import BackendError, InputError, Problem


class Normal(StrEnum):
    """Axis along which waves cross an interface."""

    x = "x"
    y = "y"
    z = "z"


AXES: dict[Normal, Literal[0, 1, 2]] = {Normal.x: 0, Normal.y: 1, Normal.z: 2}


def verify_interface(
    case: CasePath,
    wavelengths: Annotated[
        str | None,
        typer.Option(
            "--wavelengths",
            help="In cells of the finest level, separated by commas.",
            metavar="LIST",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Folder; default runs/NAME-interface.", metavar="DIR"),
    ] = None,
    force: Force = False,
    quick: Annotated[
        bool,
        typer.Option("--quick", help="Fewer wavelengths, no oblique waves, no runs of MD only."),
    ] = False,
    axis: Annotated[
        Normal | None,
        typer.Option("--axis", help="Normal of the interface; default: first of the case."),
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option(
            "--jobs", min=1, help="Strips that run at the same time; default: number of cores."
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Send waves through the interface of a case, on strips of its crystal."""
    from gimpmd_deploy.figures.crossing import draw_crossing
    from gimpmd_deploy.verify import interface, table, tasks

    body = read_case(case)
    folder = out or Path("runs") / f"{body.name}-interface"
    default = (tasks.QUICK if quick else tasks.WAVELENGTHS)[body.dim]
    console = standard_output()
    verdict = interface.verify_interface(
        case,
        folder,
        default if wavelengths is None else _numbers("--wavelengths", wavelengths),
        quick=quick,
        force=force,
        axis=None if axis is None else AXES[axis],
        jobs=jobs,
        console=Console(stderr=True) if as_json else console,
    )
    try:
        draw_crossing(verdict, folder / "interface.png")
    except BackendError as error:  # no matplotlib
        print_error(f"no figure: {error}")
    if as_json:
        print_json(verdict)
    else:
        table.print_verdict(verdict, console)
        console.print(f"results in {folder}")


def _numbers(option: str, text: str) -> list[float]:
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        problem = Problem(option, text, "is not a list of numbers", "write for example 6,8,12")
        raise InputError("gimpmd", [problem]) from None

"""``gimpmd film``: a film of a field over the outputs of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gimpmd_deploy.cli.options import RunPath
from gimpmd_deploy.cli.pictures import FieldLimits, FieldWindow, choice_of


def film(
    run: RunPath,
    field: Annotated[
        str | None,
        typer.Option(help="The field; default is the first of output.figures in the case."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="A name with .mp4, .gif or .png; default figures/FIELD.mp4."
        ),
    ] = None,
    rate: Annotated[float, typer.Option(min=0.1, max=60, help="Outputs per second.")] = 8.0,
    limits: FieldLimits = None,
    window: FieldWindow = None,
) -> None:
    """Make a film of a field, with one picture for each output of the run."""
    from gimpmd_deploy.figures.fields import check_names
    from gimpmd_deploy.figures.film import check_film, draw_film
    from gimpmd_deploy.results.run import Run

    opened = Run(run)
    name = field or next(iter(opened.case.output.figures), "sigma_yy")
    path = out or opened.folder / "figures" / f"{name}.mp4"
    check_film(path)
    check_names(opened, [name])
    path.parent.mkdir(parents=True, exist_ok=True)
    typer.echo(str(draw_film(opened, name, path, rate, choice_of(limits, window, [name]))))

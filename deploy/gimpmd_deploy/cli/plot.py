"""``gimpmd plot``: draw the figures of a run."""

from __future__ import annotations

from typing import Annotated

import typer

from gimpmd_deploy.cli.options import RunPath
from gimpmd_deploy.cli.pictures import FieldLimits, FieldWindow, choice_of, times_near


def plot(
    run: RunPath,
    field: Annotated[
        list[str] | None,
        typer.Option(
            "--field", help="Draw this field, such as sigma_xx or velocity_y; may be repeated."
        ),
    ] = None,
    time: Annotated[
        list[float] | None,
        typer.Option("--time", help="Draw fields at this output only; may be repeated."),
    ] = None,
    limits: FieldLimits = None,
    window: FieldWindow = None,
    every: Annotated[bool, typer.Option("--all", help="Draw fields at every output.")] = False,
) -> None:
    """Draw the figures of a run again; with --field, --time or --window only fields."""
    from gimpmd_deploy.figures.fields import check_names, draw_fields, some_times
    from gimpmd_deploy.figures.registry import draw_all
    from gimpmd_deploy.results.run import Run

    opened = Run(run)
    if not (field or time or window or limits):
        drawn = draw_all(opened, every)
    else:
        names = field or list(opened.case.output.figures)
        check_names(opened, names)
        choice = choice_of(limits, window, names)
        times = times_near(opened, time) if time else some_times(opened, every)
        folder = opened.folder / "figures"
        folder.mkdir(exist_ok=True)
        drawn = draw_fields(opened, names, folder, times, choice)
    for path in drawn:
        typer.echo(str(path))

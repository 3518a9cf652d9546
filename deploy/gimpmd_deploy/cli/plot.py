"""``gimpmd plot``: draw the figures of a run."""

from __future__ import annotations

from typing import Annotated

import typer

from gimpmd_deploy.cli.options import RunPath


def plot(
    run: RunPath,
    every: Annotated[bool, typer.Option("--all", help="Draw the stress at every output.")] = False,
) -> None:
    """Draw the figures of a run again."""
    from gimpmd_deploy.figures.registry import draw_all
    from gimpmd_deploy.results.run import Run

    for path in draw_all(Run(run), every):
        typer.echo(str(path))

"""``gimpmd compare``: compare two runs of one case."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gimpmd_deploy.cli.options import Json, print_json, standard_output


def compare(
    a: Annotated[Path, typer.Argument(metavar="A", help="Run folder, for example coupled.")],
    b: Annotated[Path, typer.Argument(metavar="B", help="Run folder, for example pure MD.")],
    as_json: Json = False,
) -> None:
    """Show the relative differences of run A from run B at every output time that they share."""
    from gimpmd_deploy.results.compare import compare as compare_runs
    from gimpmd_deploy.results.run import Run
    from gimpmd_deploy.results.tables import print_comparison

    comparison = compare_runs(Run(a), Run(b))
    if as_json:
        print_json(comparison)
    else:
        print_comparison(comparison, standard_output())

"""Arguments and options that several commands share, and their output."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.console import Console


class Side(StrEnum):
    """One side of a coupled case."""

    md = "md"
    continuum = "continuum"


CasePath = Annotated[Path, typer.Argument(metavar="CASE", help="Case file (YAML).")]
RunPath = Annotated[Path, typer.Argument(metavar="RUN", help="Run folder.")]
Only = Annotated[
    Side | None, typer.Option("--only", help="Run only this side, over the whole domain.")
]
Out = Annotated[
    Path | None, typer.Option("--out", help="Run folder; default runs/NAME.", metavar="DIR")
]
Force = Annotated[bool, typer.Option("--force", help="Overwrite the run in the folder.")]
RanksMd = Annotated[
    int | None, typer.Option("--ranks-md", min=1, help="MPI ranks of the MD service.")
]
RanksGimp = Annotated[
    int | None, typer.Option("--ranks-gimp", min=1, help="MPI ranks of the GIMP service.")
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output.")]


def standard_output() -> Console:
    """Return standard output; without a terminal, lines are not folded."""
    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=140)


def print_json(answer: msgspec.Struct) -> None:
    """Print a struct as one JSON object."""
    typer.echo(msgspec.json.encode(answer).decode())

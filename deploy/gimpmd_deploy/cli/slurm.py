"""``gimpmd slurm``: make the run folder of a case, and a batch script that runs it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from gimpmd_deploy.cli.options import CasePath, Force, Only, Out, RanksGimp, RanksMd
from gimpmd_deploy.cli.prepare import make_folder
from gimpmd_deploy.launch.services import run_id
from gimpmd_deploy.launch.slurm import script, submit

NOTICE = 300
"""Seconds before the time limit at which a run is asked to end, if nothing else is said."""


def slurm(
    case: CasePath,
    only: Only = None,
    out: Out = None,
    force: Force = False,
    ranks_md: RanksMd = None,
    ranks_gimp: RanksGimp = None,
    time: Annotated[str, typer.Option(help="Time limit, as Slurm writes it.")] = "24:00:00",
    notice: Annotated[
        int, typer.Option(min=1, help="Seconds before the limit at which the run is to end.")
    ] = NOTICE,
    option: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="Option of sbatch, such as nodes=4; repeatable."),
    ] = None,
    send: Annotated[bool, typer.Option("--submit", help="Submit the job.")] = False,
) -> None:
    """Make a run folder on a cluster with Slurm, and the batch script RUN/job.sh."""
    plan, folder, warnings = make_folder(case, only, out, force, ranks_md, ranks_gimp)
    path = folder / "job.sh"
    programs = Path(sys.executable).parent
    text = script(plan, folder, run_id(plan), time, notice, option or [], programs)
    path.write_text(text, encoding="utf-8")
    for warning in warnings:
        typer.echo(f"warning: {warning}", err=True)
    typer.echo(f"job {submit(path)} runs {path}" if send else f"to submit it: sbatch {path}")

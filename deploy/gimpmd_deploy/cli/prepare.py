"""``gimpmd prepare``: make the folder of a run whose services are started by hand."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from gimpmd_deploy.cli.options import CasePath, Force, Only, Out, RanksGimp, RanksMd, Side
from gimpmd_deploy.launch.by_hand import PATIENCE, commands, host_of, meeting_place
from gimpmd_deploy.launch.processes import ENVIRONMENT
from gimpmd_deploy.launch.reading import read_case
from gimpmd_deploy.launch.run import default_folder, make_run_folder
from gimpmd_deploy.launch.services import NAMES, run_id
from gimpmd_schemas.case.cautions import cautions
from gimpmd_schemas.case.plan import Plan


def prepare(
    case: CasePath,
    only: Only = None,
    out: Out = None,
    force: Force = False,
    ranks_md: RanksMd = None,
    ranks_gimp: RanksGimp = None,
    listen: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT",
            help="Where the coupler listens for other hosts, with TLS and new keys; without it, "
            "all services run on one host.",
        ),
    ] = None,
) -> None:
    """Make a run folder, and print the commands that start its services by hand."""
    if listen is not None:
        host_of(listen)
    plan, folder, warnings = make_folder(case, only, out, force, ranks_md, ranks_gimp)
    endpoint = meeting_place(folder, listen, {role: plan.ranks(role) for role in plan.roles})
    for warning in warnings:
        typer.echo(f"# warning: {warning}")
    typer.echo(f"# start these in any order, within {PATIENCE / 60:g} minutes of each other")
    settings = " ".join(f"{name}={value}" for name, value in ENVIRONMENT.items())
    typer.echo(f"export {settings}")
    ranks = {NAMES[role]: plan.ranks(role) for role in plan.roles}
    for name, words in commands(plan, folder, run_id(plan), endpoint).items():
        launcher = ["mpiexec", "-n", str(ranks[name])] if name in ranks else []
        typer.echo(shlex.join([*launcher, *words]))


def make_folder(
    case: Path,
    only: Side | None,
    out: Path | None,
    force: bool,
    ranks_md: int | None,
    ranks_gimp: int | None,
) -> tuple[Plan, Path, tuple[str, ...]]:
    """Make the run folder of a case; return the plan, the folder, and warnings for the user."""
    checked = read_case(case, only.value if only else None, ranks_md, ranks_gimp)
    folder = out or default_folder(checked)
    probe, plan = make_run_folder(checked, case, folder, force)
    return plan, folder, (*cautions(plan), *probe.notes)

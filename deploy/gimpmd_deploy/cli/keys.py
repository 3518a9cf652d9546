"""``gimpmd keys new``: make the keys with which the services of a run meet across hosts."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gimpmd_deploy.launch.keys import DAYS, new_keys
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.wire.access import (
    AUTHORITY,
    COUPLER,
    ROLES,
    USERS,
    certificate,
    names,
    password,
    private_key,
)


def new(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="New folder for the keys.")],
    host: Annotated[
        list[str],
        typer.Option(help="Name or address of the coupler's host; may be given several times."),
    ],
    ranks_md: Annotated[int, typer.Option(min=1, help="Number of ranks of the MD service.")] = 1,
    ranks_gimp: Annotated[
        int, typer.Option(min=1, help="Number of ranks of the continuum service.")
    ] = 1,
    days: Annotated[int, typer.Option(min=1, help="Days for which they are valid.")] = DAYS,
) -> None:
    """Make an authority for one run, a certificate for each rank, and passwords."""
    ranks: dict[Role, int] = {"md": ranks_md, "continuum": ranks_gimp}
    new_keys(folder, host, ranks, days)
    typer.echo(f"what each process needs of {folder}; all but {AUTHORITY} is secret:")
    owners = {COUPLER: USERS} | {n: password(r) for r in ROLES for n in names({r: ranks[r]})}
    for name, secret in owners.items():
        files = AUTHORITY, certificate(name), private_key(name), secret
        typer.echo(f"  {name}: {' '.join(files)}")

"""``gimpmd keys new``: make the keys with which the services of a run meet across hosts."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gimpmd_deploy.launch.keys import DAYS, new_keys
from gimpmd_schemas.wire.access import AUTHORITY, MEMBERS, USERS, certificate, password, private_key


def new(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="New folder for the keys.")],
    host: Annotated[
        list[str],
        typer.Option(help="Name or address of the coupler's host; may be given several times."),
    ],
    days: Annotated[int, typer.Option(min=1, help="Days for which they are valid.")] = DAYS,
) -> None:
    """Make an authority for one run, and a certificate and a password for each service."""
    new_keys(folder, host, days)
    typer.echo(f"what each host needs of {folder}; all but {AUTHORITY} is secret:")
    for member in MEMBERS:
        secret = USERS if member == "coupler" else password(member)
        files = AUTHORITY, certificate(member), private_key(member), secret
        typer.echo(f"  {member}: {' '.join(files)}")

"""``gimpmd doctor``: what is wrong with this host, or with the way to a coupler."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from gimpmd_deploy.cli.options import Side, standard_output
from gimpmd_deploy.launch.doctor import examine_host, examine_way
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.wire.access import KEYS


def doctor(
    connect: Annotated[
        str | None, typer.Option(metavar="ENDPOINT", help="Check the way to this coupler too.")
    ] = None,
    keys: Annotated[Path, typer.Option(help="Folder of the keys, for TLS.")] = Path(KEYS),
    role: Annotated[Side, typer.Option(help="The side as which this host takes part.")] = Side.md,
) -> None:
    """Check this host, and the way from it to a coupler that runs."""
    findings = list(examine_host())
    if connect is not None:
        findings += examine_way(connect, keys, role.value)
    table = Table.grid(padding=(0, 2))
    for finding in findings:
        table.add_row("problem" if finding.hint else "ok", finding.what, finding.text)
        if finding.hint:
            table.add_row("", "", f"-> {finding.hint}")
    standard_output().print(table)
    problems = [finding for finding in findings if finding.hint]
    if problems:
        names = ", ".join(finding.what for finding in problems)
        raise BackendError(f"{len(problems)} of {len(findings)} checks failed: {names}")

"""``gimpmd backends``: the codes that can run each side, and what each of them can do."""

from __future__ import annotations

import typer
from rich.table import Table

from gimpmd_deploy.cli.options import standard_output
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.registry import InstalledCode, installed_codes

SIDES: dict[Role, str] = {"md": "potentials", "continuum": "laws"}
"""The sides, and what the materials of their codes are."""


def backends() -> None:
    """List the codes that are installed for md.backend and continuum.backend."""
    for role, materials in SIDES.items():
        typer.echo(f"{role}.backend:")
        table = Table.grid(padding=(0, 2))
        for code in installed_codes(role):
            for row, (what, value) in enumerate(_rows(code, materials)):
                table.add_row("" if row else f"  {code.name}", what, value)
        standard_output().print(table)


def _rows(code: InstalledCode, materials: str) -> list[tuple[str, str]]:
    if code.problem:
        return [("cannot be used", code.problem)]
    if code.abilities is None:
        return [("version", code.version), ("abilities", "not stated")]
    found = code.abilities
    return [
        ("version", code.version),
        ("dimensions", " and ".join(map(str, found.dimensions))),
        (materials, found.materials),
        ("schemes", ", ".join(found.schemes)),
        ("ranks", "any number" if found.ranks is None else f"at most {found.ranks}"),
        ("checkpoint", "yes" if found.checkpoint else "no"),
    ]

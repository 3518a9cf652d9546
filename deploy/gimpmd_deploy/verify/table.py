"""The verdict of a verification as a table on a console."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from gimpmd_deploy.verify.verdict import Verdict


def print_verdict(verdict: Verdict, console: Console) -> None:
    """Show all rows, then the result."""
    table = Table(box=None, header_style="bold")
    for name in ("wave", "angle", "way", "R", "T", "grid R", "grid T", "MD R", "MD T", ""):
        table.add_column(name, justify="left" if name in ("wave", "way", "") else "right")
    for row in verdict.rows:
        table.add_row(
            f"{row.polarization} {row.wavelength:g} h",
            f"{row.degrees:.0f}",
            row.travel,
            *(
                "-" if share is None else f"{share:.4f}"
                for share in (
                    row.reflected,
                    row.transmitted,
                    row.grid_reflected,
                    row.grid_transmitted,
                    row.md_reflected,
                    row.md_transmitted,
                )
            ),
            "" if row.faithful else "not faithful",
        )
    console.print(table)
    console.print(
        f"scheme {verdict.scheme}, N = {verdict.md_steps}, interface normal to {verdict.axis}"
    )
    if abs(verdict.cell - verdict.case_cell) > 1e-6 * verdict.case_cell:
        console.print(
            f"h = {verdict.cell:.6g}, which is {verdict.case_cell:g} fitted to the crystal"
        )
    console.print(f"faithful: {verdict.criterion}")
    if verdict.shortest is None:
        console.print("no wavelength that was run crosses the interface faithfully")
    else:
        console.print(
            f"shortest wavelength that crosses faithfully: {verdict.shortest:g} h = "
            f"{verdict.shortest * verdict.cell:.4g}"
        )

"""How MPI ranks divide the atoms and the grid."""

from __future__ import annotations

from math import prod
from typing import Literal

from gimpmd_schemas.case.checks.rules import Rules
from gimpmd_schemas.case.derive.levels import finest_cell
from gimpmd_schemas.case.derive.regions import continuum_patches, md_region
from gimpmd_schemas.case.form import Case


def check_patches(case: Case, rules: Rules) -> None:
    """Patches that multiply to the ranks, each with at least one cell."""
    if case.only != "continuum":
        cells = prod(high - low for low, high in md_region(case)) / finest_cell(case) ** 2
        rules.require(
            case.atoms.ranks <= max(1.0, cells),
            "md.ranks",
            case.atoms.ranks,
            f"are more than the {cells:.4g} cells of the MD region",
            "each rank should have hundreds of atoms; use fewer ranks",
        )
        _check_tiling("md", case.atoms.patches, case.atoms.ranks, rules)
    if case.only == "md":
        return
    counts = [round((high - low) / case.grid.cell) for low, high in case.domain.box]
    ranks = case.continuum.ranks
    if not rules.require(
        ranks <= prod(counts),
        "continuum.ranks",
        ranks,
        f"are more than the {prod(counts)} cells of level 0",
        "each rank should have thousands of points; use fewer ranks",
    ):
        return
    if not _check_tiling("continuum", case.continuum.patches, ranks, rules):
        return
    patches = continuum_patches(case)
    rules.require(
        all(p <= n for p, n in zip(patches, counts, strict=True)),
        "continuum.patches",
        list(patches),
        f"are more than the {' x '.join(map(str, counts))} cells of level 0 along an axis",
        "use fewer ranks, or give patches with at least one cell each",
    )


def _check_tiling(
    side: str, patches: tuple[int, ...] | Literal["auto"], ranks: int, rules: Rules
) -> bool:
    return patches == "auto" or rules.require(
        min(patches) >= 1 and prod(patches) == ranks,
        f"{side}.patches",
        list(patches),
        f"do not tile the region over {side}.ranks = {ranks}: "
        f"{' x '.join(map(str, patches))} = {prod(patches)}",
        "make the product equal the number of ranks, or write auto",
    )

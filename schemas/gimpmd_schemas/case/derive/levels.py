"""Cells and boxes of the grid levels."""

from __future__ import annotations

from gimpmd_schemas.case.form import Case, Domain
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.zones import Box


def cells(case: Case) -> tuple[float, ...]:
    """Edge of the cells of each level (length units), level 0 (coarsest) first."""
    return tuple(case.grid.cell / 2**k for k in range(len(case.grid.levels) + 1))


def finest_cell(case: Case) -> float:
    """Edge of the cells of the finest level: the h of the coupling (length units)."""
    return cells(case)[-1]


def boxes(case: Case) -> tuple[tuple[Box, ...], ...]:
    """Boxes of each level. Level 0 is the domain."""
    return ((case.domain.box,), *(level.boxes for level in case.grid.levels))


def background_grid(domain: Domain, cell: float) -> BackgroundGrid:
    """Make the grid that both sides share, of cells with this edge."""
    return BackgroundGrid(
        tuple(low for low, _ in domain.box),
        cell,
        tuple(round((high - low) / cell) for low, high in domain.box),
        domain.periodic,
    )

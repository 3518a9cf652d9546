"""Domain, cells and MD regions."""

from __future__ import annotations

from math import prod

from gimpmd_schemas.case.checks.rules import AXES, Rules
from gimpmd_schemas.case.derive import levels
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.grid.zones import Box

MAX_CELLS = 10**9
"""Largest accepted number of cells. The nodes of more cells do not fit into memory."""


def check_geometry(case: Case, rules: Rules) -> bool:
    """Check domain, cells and MD regions; returns whether they make sense."""
    before = len(rules.problems)
    h = case.grid.cell
    for axis, name in enumerate(AXES[: case.dim]):
        low, high = case.domain.box[axis]
        if not rules.require(
            high > low,
            "domain.box",
            case.domain.box,
            f"upper {name} is not above lower {name}",
            f"write {name} as [lower, upper]",
        ):
            continue
        cells = (high - low) / h
        rules.require(
            abs(cells - round(cells)) < 1e-6 and round(cells) >= 1,
            "grid.cell",
            h,
            f"does not divide the domain along {name}: {high - low:g} / {h:g} = {cells:.6g} cells",
            f"a cell of {(high - low) / max(1, round(cells)):.9g} would",
        )
        if case.md is not None:
            for key, region in case.md.boxes().items():
                _check_region(case, region, key, axis, rules)
    rules.require(
        case.grid.points_per_axis in (1, 2, 3, 4),
        "grid.points_per_axis",
        case.grid.points_per_axis,
        "must be 1, 2, 3 or 4",
    )
    first = case.time.md_timestep
    rules.require(
        first is None or case.time.end >= first,
        "time.end",
        case.time.end,
        "is before the first MD step",
        f"at least {first:g}, one time.md_timestep" if first else "",
    )
    rules.require(
        case.continuum.interpolation != "cpgimp" or case.grid.points_per_axis > 1,
        "continuum.interpolation",
        case.continuum.interpolation,
        "needs room for points to stretch within a cell",
        "set grid.points_per_axis to 2 or more, or use ugimp",
    )
    return len(rules.problems) == before


def _check_region(case: Case, region: Box, key: str, axis: int, rules: Rules) -> None:
    """Check that an MD region lies inside the domain along an axis."""
    (low, high), (rlow, rhigh), name = case.domain.box[axis], region[axis], AXES[axis]
    if not rules.require(
        rhigh > rlow,
        key,
        region,
        f"upper {name} is not above lower {name}",
        f"write {name} as [lower, upper]",
    ):
        return
    eps = 1e-9 * case.grid.cell
    inside = rlow >= low - eps and rhigh <= high + eps
    rules.require(
        inside,
        key,
        region,
        f"leaves the domain along {name}: [{low:g}, {high:g}]",
        "move the region inside the domain",
    )
    if case.domain.periodic[axis] and inside:
        spans = abs(rlow - low) < eps and abs(rhigh - high) < eps
        rules.require(
            spans,
            key,
            region,
            f"must span the whole domain along the periodic axis {name}",
            f"set it to [{low:g}, {high:g}] along {name}",
        )


def check_size(case: Case, rules: Rules) -> None:
    """Check that the cells fit into memory."""
    cells = sum(
        prod((high - low) / h for low, high in box)
        for h, boxes in zip(levels.cells(case), levels.boxes(case), strict=True)
        for box in boxes
    )
    rules.require(
        cells <= MAX_CELLS,
        "grid.cell",
        case.grid.cell,
        f"gives {cells:.3g} cells, more than {MAX_CELLS:g}",
        "enlarge the cell, or make the domain or its refined boxes smaller",
    )
    shared = prod((high - low) / levels.finest_cell(case) for low, high in case.domain.box)
    rules.require(
        case.only == "continuum" or shared <= MAX_CELLS,
        "grid.levels",
        len(case.grid.levels),
        f"gives {shared:.3g} finest cells in the domain, on which both sides number their "
        f"nodes; more than {MAX_CELLS:g}",
        "refine less, or enlarge grid.cell",
    )

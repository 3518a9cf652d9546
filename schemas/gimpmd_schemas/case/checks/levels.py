"""Where the grid may be refined, and what must lie inside one level."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.checks.rules import AXES, Rules
from gimpmd_schemas.case.derive.levels import boxes as level_boxes
from gimpmd_schemas.case.derive.levels import cells as level_cells
from gimpmd_schemas.case.derive.levels import finest_cell
from gimpmd_schemas.case.derive.zones import zones as zones_of
from gimpmd_schemas.case.form import AT_PLANES, Case, Crack
from gimpmd_schemas.grid.zones import Box, MdRegion

MAX_LEVELS = 8
"""Largest number of levels including the coarsest: the cells differ by a factor of 128."""

MARGIN = 4
"""Least gap between the edges of a level and those of the coarser level around it, and between
boxes, in cells of the coarser level."""

NARROWEST = 4
"""Least width of a box, in its own cells."""

OUTSIDE = 4
"""Finest cells that a coupled run needs around the filter of its MD region."""

CRACK_MARGIN = 3
"""Least gap between a crack and the edge of its level, in cells of that level."""


def check_levels(case: Case, rules: Rules) -> bool:
    """Check the boxes of each level against the coarser level; returns whether all are valid.

    The checks end at the first level with a problem.
    """
    levels = case.grid.levels
    if not rules.require(
        len(levels) < MAX_LEVELS,
        "grid.levels",
        len(levels),
        f"gives {len(levels) + 1} levels, more than {MAX_LEVELS}",
        "refine less, or reduce grid.cell",
    ):
        return False
    before = len(rules.problems)
    for k in range(1, len(levels) + 1):
        key = f"grid.levels[{k - 1}].boxes"
        rules.require(
            bool(levels[k - 1].boxes), key, [], "holds no box", "add one, or leave the level out"
        )
        for j, box in enumerate(levels[k - 1].boxes):
            _check_box(case, k, box, f"{key}[{j}]", rules)
        _check_gaps(case, k, key, rules)
        if len(rules.problems) > before:
            return False
    return True


def _check_box(case: Case, k: int, box: Box, key: str, rules: Rules) -> None:
    coarse, fine = level_cells(case)[k - 1 : k + 1]
    for axis, ((low, high), (origin, _)) in enumerate(zip(box, case.domain.box, strict=True)):
        name = AXES[axis]
        if not rules.require(
            high > low,
            key,
            box,
            f"upper {name} is not above lower {name}",
            f"write {name} as [lower, upper]",
        ):
            return
        lines = [(x - origin) / coarse for x in (low, high)]
        nearest = [origin + round(x) * coarse for x in lines]
        if not rules.require(
            all(abs(x - round(x)) < 1e-6 for x in lines),
            key,
            box,
            f"its {name} faces miss the node lines of level {k - 1}, {coarse:g} apart",
            f"[{nearest[0]:.9g}, {nearest[1]:.9g}] along {name} would do",
        ):
            return
        rules.require(
            high - low >= (NARROWEST - 1e-6) * fine,
            key,
            box,
            f"is {(high - low) / fine:.3g} of its cells wide along {name}; it needs {NARROWEST}",
            f"make it at least {NARROWEST * fine:g} wide",
        )
    rules.require(
        any(_is_nested(case, box, parent, MARGIN * coarse) for parent in level_boxes(case)[k - 1]),
        key,
        box,
        f"does not lie inside a box of level {k - 1} with {MARGIN} cells of that level around it",
        f"leave {MARGIN * coarse:g} on every side, or let both boxes end on the same face of the "
        "domain or span the same periodic axis",
    )


def _is_nested(case: Case, box: Box, parent: Box, margin: float) -> bool:
    """Whether a box lies inside another with a margin, except where both end at the domain."""
    eps = 1e-6 * margin
    for axis, domain in enumerate(case.domain.box):
        gaps = (box[axis][0] - parent[axis][0], parent[axis][1] - box[axis][1])
        at_end = [
            all(abs(b[axis][side] - domain[side]) < eps for b in (box, parent)) for side in range(2)
        ]
        if case.domain.periodic[axis]:
            at_end = [all(at_end)] * 2
        if any(gap < margin - eps and not end for gap, end in zip(gaps, at_end, strict=True)):
            return False
    return True


def _check_gaps(case: Case, k: int, key: str, rules: Rules) -> None:
    need = MARGIN * level_cells(case)[k - 1]
    for (i, a), (j, b) in combinations(enumerate(level_boxes(case)[k]), 2):
        gap = max(max(q[0] - p[1], p[0] - q[1]) for p, q in zip(a, b, strict=True))
        rules.require(
            gap >= need * (1.0 - 1e-6),
            f"{key}[{j}]",
            b,
            f"overlaps box {i} or is closer to it than {MARGIN} cells of level {k - 1}",
            f"keep them {need:g} apart, or merge the two boxes",
        )


def check_finest_box(case: Case, rules: Rules) -> None:
    """Check that each MD region, its filter and some cells around lie in one finest box."""
    zones = zones_of(case)
    filtered = 0.0 if case.coupling.scheme in AT_PLANES else zones.filter
    for region in zones.regions:
        _check_finest_box(case, region, filtered, rules)


def _check_finest_box(case: Case, region: MdRegion, filtered: float, rules: Rules) -> None:
    h = finest_cell(case)
    need = filtered + OUTSIDE * h
    wanted = tuple(
        (
            max(low - need, lo) if at_low else lo,
            min(high + need, hi) if at_high else hi,
        )
        for (low, high), (at_low, at_high), (lo, hi) in zip(
            region.box, region.interfaces, case.domain.box, strict=True
        )
    )
    rules.require(
        any(_holds(box, wanted, 1e-6 * h) for box in level_boxes(case)[-1]),
        "grid.levels",
        case.grid.levels[-1].boxes if case.grid.levels else [],
        f"no box of the finest level holds the MD region, its filter ({filtered:g}) and "
        f"{OUTSIDE} cells ({OUTSIDE * h:g}) around",
        f"give the last level a box that covers at least {[list(pair) for pair in wanted]}",
    )


def crack_level(case: Case, crack: Crack) -> int | None:
    """Level that contains a whole crack with three cells around it; None if there is none."""
    corners = np.array(crack.corners())
    boxes = (*level_boxes(case), ())
    for k, h in enumerate(level_cells(case)):
        inside = any(
            _holds(_shrunk(case, box, CRACK_MARGIN * h), _bounds(corners), 1e-9 * h)
            for box in boxes[k]
        )
        margin = (CRACK_MARGIN - 1e-6) * h
        grown = [tuple((lo - margin, hi + margin) for lo, hi in box) for box in boxes[k + 1]]
        if inside and not any(meets(corners, box) for box in grown):
            return k
    return None


def _shrunk(case: Case, box: Box, margin: float) -> Box:
    """Reduce a box by a margin, except at the faces of the domain."""
    eps = 1e-6 * margin
    return tuple(
        (
            low if abs(low - lo) < eps else low + margin,
            high if abs(high - hi) < eps else high - margin,
        )
        for (low, high), (lo, hi) in zip(box, case.domain.box, strict=True)
    )


def _bounds(corners: Floats) -> Box:
    return tuple(zip(corners.min(axis=0).tolist(), corners.max(axis=0).tolist(), strict=True))


def _holds(box: Box, other: Box, slack: float) -> bool:
    return all(
        a[0] <= b[0] + slack and b[1] <= a[1] + slack for a, b in zip(box, other, strict=True)
    )


def meets(corners: Floats, box: Box) -> bool:
    """Whether a segment or a plane convex polygon intersects a box.

    Parameters
    ----------
    corners : ndarray, shape ``(n, d)``
        Corners of the segment or polygon.
    box : Box
    """
    polygon: Sequence[Floats] = list(corners)
    for axis, pair in enumerate(box):
        for bound, sign in zip(pair, (1.0, -1.0), strict=True):
            kept = []
            for a, b in zip(polygon, [*polygon[1:], *polygon[:1]], strict=True):
                da, db = sign * (a[axis] - bound), sign * (b[axis] - bound)
                if da >= 0.0:
                    kept.append(a)
                if da * db < 0.0:
                    kept.append(a + (b - a) * da / (da - db))
            polygon = kept
    return bool(polygon)

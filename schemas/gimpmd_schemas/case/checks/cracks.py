"""Cracks of the continuum."""

from __future__ import annotations

import numpy as np

from gimpmd_schemas.case.checks.levels import CRACK_MARGIN, crack_level
from gimpmd_schemas.case.checks.rules import Rules
from gimpmd_schemas.case.derive.levels import cells as level_cells
from gimpmd_schemas.case.derive.zones import zones as zones_of
from gimpmd_schemas.case.form import Case, Crack

J_CELLS = 2
"""Least radius of a J-integral's domain, in cells."""


def check_cracks(case: Case, rules: Rules) -> None:
    """Cracks inside the body, of one level, and out of the coupling's way."""
    rules.require(
        not (case.continuum.cracks and any(case.domain.periodic)),
        "continuum.cracks",
        len(case.continuum.cracks),
        "cracks of the continuum cannot be combined with periodic axes yet",
        "make the domain free along all axes, or leave the cracks out",
    )
    for index, crack in enumerate(case.continuum.cracks):
        _check_crack(case, crack, f"continuum.cracks[{index}]", rules)


def _check_crack(case: Case, crack: Crack, key: str, rules: Rules) -> None:
    ends = [list(crack.start), list(crack.end)]
    line = np.array(crack.end) - np.array(crack.start)
    if not rules.require(
        bool(line.any()), key, ends, "has no length", "let from and to differ"
    ) or not rules.require(
        (crack.along is None) == (case.dim == 2),
        f"{key}.along",
        crack.along,
        "belongs to cracks in three dimensions" if crack.along else "missing in three dimensions",
        "leave it out" if crack.along else "give the vector that makes from and to a parallelogram",
    ):
        return
    if crack.along is not None and not rules.require(
        bool(np.cross(line, crack.along).any()),
        f"{key}.along",
        crack.along,
        "is parallel to the crack, so the crack has no area",
        "give a vector that is not parallel to it",
    ):
        return
    rules.require(crack.friction >= 0, f"{key}.friction", crack.friction, "must not be negative")
    rules.require(
        crack.friction == 0 or crack.contact == "frictional",
        f"{key}.friction",
        crack.friction,
        "has no meaning without contact",
        "write contact: frictional",
    )
    first = case.continuum.cracks[0]
    rules.require(
        (crack.contact, crack.friction) == (first.contact, first.friction),
        f"{key}.contact",
        crack.contact,
        "differs from the first crack's, in kind or friction",
        "give all cracks the same contact and friction",
    )
    inside = True
    for corner in crack.corners():
        inside &= rules.require(
            all(lo <= x <= hi for x, (lo, hi) in zip(corner, case.domain.box, strict=True)),
            key,
            ends,
            f"its end ({', '.join(f'{x:g}' for x in corner)}) leaves the domain",
            f"the domain is {' x '.join(f'[{lo:g}, {hi:g}]' for lo, hi in case.domain.box)}",
        )
    if not inside:
        return
    level = crack_level(case, crack)
    if rules.require(
        level is not None,
        key,
        ends,
        f"comes within {CRACK_MARGIN} cells of the rim of a level, or crosses it",
        f"let it lie, with {CRACK_MARGIN} cells to spare, in a box of one level and in no finer",
    ):
        _check_j_integral(case, crack, level_cells(case)[level or 0], key, rules)
    if case.only is None:
        zones = zones_of(case)
        corners = np.array(ends, dtype=float)
        rules.require(
            any((one.depth(corners) > zones.innermost).all() for one in zones.regions),
            key,
            ends,
            "reaches the zones or the continuum of the coupled run",
            "cracks belong inside an MD region, deeper than the inner zone",
        )


def _check_j_integral(case: Case, crack: Crack, h: float, key: str, rules: Rules) -> None:
    radius = crack.j_radius
    if radius is None:
        return
    length = float(np.linalg.norm(np.array(crack.end) - np.array(crack.start)))
    room = min(
        min(x - lo, hi - x)
        for x, (lo, hi) in list(zip(crack.end, case.domain.box, strict=True))[:2]
    )
    most = min(length, room)
    rules.require(
        J_CELLS * h <= radius <= most,
        f"{key}.j_radius",
        radius,
        f"must lie between {J_CELLS} cells ({J_CELLS * h:g}) and {most:g}, where the domain or "
        "the crack ends",
        "leave it out to skip the J-integral",
    )

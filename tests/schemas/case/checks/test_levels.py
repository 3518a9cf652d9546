"""Geometry behind the rules of levels: which level holds a crack, and what meets a box."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimpmd_schemas.case.checks.levels import crack_level, meets
from gimpmd_schemas.case.form import Case, Crack

coordinate = st.integers(-6, 6).map(lambda n: n / 2)
point = st.tuples(coordinate, coordinate, coordinate)
CUBE = ((-1.0, 1.0),) * 3


@given(point, point, point)
def test_a_parallelogram_meets_a_box_where_its_points_lie_in_it(
    corner: tuple[float, ...], first: tuple[float, ...], second: tuple[float, ...]
) -> None:
    """Against points on a fine lattice of the parallelogram."""
    a, p, q = (np.array(x) for x in (corner, first, second))
    polygon = np.array([a, a + p, a + p + q, a + q])
    s, t = (x.ravel()[:, None] for x in np.meshgrid(*[np.linspace(0, 1, 61)] * 2))
    x = a + s * p + t * q
    inside = (np.abs(x) <= 1.0).all(axis=1)
    if inside.any():
        assert meets(polygon, CUBE)
    # no point of the parallelogram is further than half a lattice cell from the lattice
    reach = float(np.abs(p).sum() + np.abs(q).sum()) / 120
    if not (np.abs(x) <= 1.0 + reach).all(axis=1).any():
        assert not meets(polygon, CUBE)


@pytest.mark.parametrize(
    ("start", "end", "hit"),
    [
        ((-2, 0), (2, 0), True),  # through
        ((-2, 1), (2, 1), True),  # along a face
        ((-2, 1.01), (2, 1.01), False),
        ((0, 0), (0.5, 0.5), True),  # within
        ((-2, 0), (0, 2.1), False),  # past a corner
        ((-2, 0), (0, 2), True),  # at the corner
        ((-3, 0), (-1.5, 0), False),  # short of it
    ],
)
def test_segments(start: tuple[float, float], end: tuple[float, float], hit: bool) -> None:
    assert meets(np.array([start, end], dtype=float), ((-1.0, 1.0), (-1.0, 1.0))) is hit


@pytest.mark.parametrize(
    ("start", "end", "level"),
    [
        ((0, 10), (40, 10), 0),
        ((64, 40), (76, 40), None),  # three cells of level 1 are 6: its rim is at 60, 100
        ((66, 40), (74.1, 40), None),
        ((66, 40), (74, 40), 1),
        ((66, 40), (82, 40), None),  # comes up to level 2 at 80
        ((83, 40), (89, 40), 2),
        ((83, 40), (90, 40), None),
    ],
)
def test_level_of_a_crack(
    make: Callable[..., Case], start: Any, end: Any, level: int | None
) -> None:
    boxes = ([[[60, 100], [20, 60]]], [[[80, 92], [32, 50]]])
    case = make(only="continuum", grid__levels=[{"boxes": b} for b in boxes])
    assert crack_level(case, Crack(start=start, end=end)) == level

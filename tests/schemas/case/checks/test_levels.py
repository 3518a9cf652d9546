"""Levels of the grid: which level holds a crack, what meets a box, and the rules."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimpmd_schemas.case.checks.levels import crack_level, meets
from gimpmd_schemas.case.form import Case, Crack
from tests.schemas.case.checks.cases import (
    BLOCK,
    FORCE,
    PAIR,
    Break,
    assert_breaks,
    assert_keeps,
    levels,
    regions,
)

Make = Callable[..., Case]
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


BREAKS: list[Break] = [
    (
        "grid.levels",
        regions(*PAIR) | {"grid__levels": [{"boxes": [[[0, 64], [0, 80]]]}]},
        "no box of the finest level holds the MD region",
    ),
    # levels
    ("grid.levels", levels(*[[[[0, 120], [0, 80]]]] * 8), "gives 9 levels, more than 8"),
    ("grid.levels[0].boxes", levels([]), "holds no box"),
    ("grid.levels[0].boxes[0]", levels([[[40, 16], [16, 40]]]), "upper x is not above"),
    ("grid.levels[0].boxes[0]", levels([[[16, 40], [16, 42]]]), "y faces miss the node lines"),
    ("grid.levels[0].boxes[0]", levels([[[16, 20], [16, 40]]]), "is 2 of its cells wide along x"),
    ("grid.levels[0].boxes[0]", levels([[[12, 40], [16, 40]]]), "does not lie inside a box"),
    ("grid.levels[0].boxes[0]", levels([[[16, 124], [16, 40]]]), "does not lie inside a box"),
    (
        "grid.levels[1].boxes[0]",
        levels([[[16, 64], [16, 64]]], [[[22, 40], [24, 40]]]),
        "does not lie inside a box of level 1",
    ),
    (  # inside level 1's two boxes together, in neither alone
        "grid.levels[1].boxes[0]",
        levels([[[16, 40], [16, 64]], [[56, 80], [16, 64]]], [[[32, 64], [32, 40]]]),
        "does not lie inside a box of level 1",
    ),
    (  # touches the domain's face, level 1 does not
        "grid.levels[1].boxes[0]",
        levels([[[16, 64], [0, 64]]], [[[0, 40], [0, 40]]]),
        "does not lie inside",
    ),
    (  # reaches one end of a periodic axis
        "grid.levels[0].boxes[0]",
        levels([[[16, 40], [0, 40]]]) | {"domain__periodic": [False, True]},
        "does not lie inside",
    ),
    (
        "grid.levels[0].boxes[1]",
        levels([[[16, 40], [16, 40]], [[52, 80], [16, 40]]]),
        "is closer to it than 4 cells of level 0",
    ),
    ("grid.levels[0].boxes[1]", levels([[[16, 40], [16, 40]]] * 2), "overlaps box 0"),
    (  # region, filter 4 and 4 cells of 2 need [0, 92] x [8, 72]
        "grid.levels",
        {"grid__levels": [{"boxes": [[[0, 88], [0, 80]]]}]},
        "no box of the finest level holds the MD region",
    ),
    (  # region and 4 cells of 2 need [0, 88] x [12, 68]
        "grid.levels",
        FORCE | {"grid__levels": [{"boxes": [[[0, 80], [0, 80]]]}]},
        "its filter (0) and 4 cells (8) around",
    ),
]

KEEPS: list[dict[str, Any]] = [
    levels(*[[[[0, 120], [0, 80]]]] * 7),
    levels([[[16, 24], [16, 24]]]),
    levels([[[16, 40], [16, 40]], [[56, 80], [16, 40]]]),
    levels([[[16, 64], [16, 64]]], [[[24, 40], [24, 56]]]),
    levels([[[0, 64], [0, 64]]], [[[0, 40], [0, 40]]]),
    levels([[[16, 40], [0, 80]]]) | {"domain__periodic": [False, True]},
    levels([[[16, 40], [16, 40]]]) | {"domain__periodic": [False, True]},
    BLOCK | {"grid__levels": [{"boxes": [[[0, 24], [0, 40], [0, 24]]]}]},
    {"grid__levels": [{"boxes": [[[0, 92], [0, 80]]]}]},
    FORCE | {"grid__levels": [{"boxes": [[[0, 88], [0, 80]]]}]},
    {"grid__levels": [{"boxes": [[[0, 104], [0, 80]]]}], "coupling__zones__filter": 16},
]


@pytest.mark.parametrize(("key", "changes", "said"), BREAKS)
def test_broken_rules(make: Make, key: str, changes: dict[str, Any], said: str) -> None:
    assert_breaks(make(**changes), key, said)


@pytest.mark.parametrize("changes", KEEPS)
def test_rules_kept_at_their_limit(make: Make, changes: dict[str, Any]) -> None:
    assert_keeps(make(**changes))

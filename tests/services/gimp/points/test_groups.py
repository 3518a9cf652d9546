"""Rules that select points."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.points.groups import (
    ALL,
    INNER,
    RIM,
    Flagged,
    Group,
    MovedFrom,
    MovedWith,
    OfLevel,
    OfLevels,
    Summed,
    SummedBeside,
)
from gimpmd_gimp.points.material_points import MaterialPoints, points_at_rest

SUMMED = np.array([0, 1, 2, 1, 2, 2], dtype=np.int32)


@pytest.fixture
def points() -> MaterialPoints:
    """Six points: levels 0, 0, 0, 1, 1, 2; the last but one is an inner point."""
    n = 6
    level = np.array([0, 0, 0, 1, 1, 2], dtype=np.int32)
    made = points_at_rest(np.zeros((n, 2)), np.ones(n), 1.0, np.ones((n, 2)), level)
    made.rate[:] = [0, 0, 1, 1, 2, 2]
    made.flags[4] = INNER.bit | 8
    return made


@pytest.mark.parametrize(
    ("group", "members"),
    [
        (ALL, [0, 1, 2, 3, 4, 5]),
        (INNER, [4]),
        (RIM, []),
        (Flagged(8), [4]),
        (OfLevel(1), [3]),
        (MovedWith(2), [5]),
        (MovedFrom(1), [2, 3, 4, 5]),
        (Summed(1), [1, 2, 3, 4, 5]),
        (OfLevels(1, 2), [3, 4, 5]),
        (SummedBeside(1, 1, 2), [1, 2]),
    ],
)
def test_members(points, group: Group, members) -> None:
    assert np.flatnonzero(group.mask(points, SUMMED)).tolist() == members


def test_groups_of_the_same_rule_are_one() -> None:
    assert {OfLevel(1): 0, OfLevels(1, 1): 1}[OfLevel(1)] == 0
    assert OfLevel(1) != OfLevel(2)

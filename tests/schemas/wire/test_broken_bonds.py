"""Broken bonds near the planes: sums over ranks, and what the user reads."""

from __future__ import annotations

import math

import pytest

from gimpmd_schemas.wire.broken_bonds import BrokenBonds, components, total, warning
from gimpmd_schemas.wire.fields import BOND_FIELDS


def test_ranks_add_up_and_the_longest_bond_gives_the_place() -> None:
    ranks = [
        BrokenBonds(count=2, stretch=1.3, place=(1.0, 2.0)),
        None,
        BrokenBonds(count=0),
        BrokenBonds(count=1, stretch=1.7, place=(3.0, 4.0)),
    ]
    assert total(ranks) == BrokenBonds(count=3, stretch=1.7, place=(3.0, 4.0))
    assert total([BrokenBonds(count=0), None]) == BrokenBonds(count=0)
    assert total([None, None]) is None


@pytest.mark.parametrize("dim", [2, 3])
def test_components_are_those_of_the_table(dim: int) -> None:
    names = [name for field in BOND_FIELDS for name in field.components(dim)]
    place = (1.5, 2.5, 3.5)[:dim]
    some = components(BrokenBonds(count=4, stretch=1.3, place=place), dim)
    none = components(BrokenBonds(count=0), dim)
    assert list(some) == list(none) == names
    assert tuple(some.values()) == (4, *place)
    assert none["broken_bonds"] == 0
    assert math.isnan(none["broken_at_x"])


def test_the_warning_says_when_and_where() -> None:
    assert "at t = 24.96, near (185.33, 226.1)" in warning(24.96, (185.3333, 226.1))

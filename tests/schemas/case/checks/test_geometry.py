"""Domain, cells and MD regions: cases that break a rule or just keep it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from gimpmd_schemas.case.form import Case
from tests.schemas.case.checks.cases import BLOCK, PAIR, Break, assert_breaks, regions

Make = Callable[..., Case]

BREAKS: list[Break] = [
    ("grid.points_per_axis", {"grid__points_per_axis": 5}, "must be 1, 2, 3 or 4"),
    ("domain.box", {"domain__box": [[0, 120], [80, 0]]}, "upper y is not above lower y"),
    ("md.region", {"md__region": [[80, 0], [20, 60]]}, "upper x is not above lower x"),
    ("grid.cell", {"grid__cell": 7}, "does not divide the domain along x"),
    ("grid.cell", {"grid__cell": 1e-3}, "gives 9.6e+09 cells"),
    ("md.region", {"md__region": [[-1, 80], [20, 60]]}, "leaves the domain along x"),
    ("md.region", {"domain__periodic": [False, True]}, "must span the whole domain"),
    ("md.regions[1]", regions([[0, 40], [20, 60]], [[60, 121], [20, 60]]), "leaves the domain"),
    ("md.regions[1]", regions(*PAIR) | {"domain__periodic": [False, True]}, "must span the whole"),
    ("time.end", {"time__end": 0.0019, "output__interval": 0.0019}, "is before the first MD step"),
    ("domain.box", BLOCK | {"domain__box": [[0, 40], [0, 40], [24, 0]]}, "upper z is not above"),
    ("grid.cell", BLOCK | {"grid__cell": 5}, "does not divide the domain along z"),
    ("grid.cell", BLOCK | {"grid__cell": 1 / 32}, "gives 1.26e+09 cells"),
]


@pytest.mark.parametrize(("key", "changes", "said"), BREAKS)
def test_broken_rules(make: Make, key: str, changes: dict[str, Any], said: str) -> None:
    assert_breaks(make(**changes), key, said)

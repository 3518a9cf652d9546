"""Patches: cases that break a rule or just keep it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from gimpmd_schemas.case.form import Case
from tests.schemas.case.checks.cases import ALONE, BLOCK, Break, assert_breaks, assert_keeps

Make = Callable[..., Case]

BREAKS: list[Break] = [
    ("md.ranks", {"md__ranks": 201}, "more than the 200 cells"),
    ("md.ranks", {"md__ranks": 2**62}, "more than the 200 cells"),
    ("continuum.ranks", {"continuum__ranks": 601}, "more than the 600 cells"),
    ("md.patches", {"md__ranks": 4, "md__patches": [3, 1]}, "3 x 1 = 3"),
    ("md.patches", {"md__ranks": 4, "md__patches": [-2, -2]}, "do not tile"),
    # patches
    ("continuum.ranks", ALONE | {"continuum__ranks": 601}, "more than the 600 cells of level 0"),
    (
        "continuum.patches",
        ALONE | {"continuum__ranks": 4, "continuum__patches": [3, 1]},
        "3 x 1 = 3",
    ),
    (
        "continuum.patches",
        ALONE | {"continuum__ranks": 31, "continuum__patches": [31, 1]},
        "more than the 30 x 20 cells",
    ),
    ("continuum.patches", ALONE | {"continuum__ranks": 37}, "more than the 30 x 20 cells"),
]

KEEPS: list[dict[str, Any]] = [
    {"md__ranks": 200},
    {"md__ranks": 4, "md__patches": [4, 1]},
    ALONE | {"continuum__ranks": 600},
    ALONE | {"continuum__ranks": 4, "continuum__patches": [4, 1]},
    BLOCK | {"continuum__ranks": 6, "continuum__patches": [1, 1, 6]},
    {"continuum__ranks": 2},
]


@pytest.mark.parametrize(("key", "changes", "said"), BREAKS)
def test_broken_rules(make: Make, key: str, changes: dict[str, Any], said: str) -> None:
    assert_breaks(make(**changes), key, said)


@pytest.mark.parametrize("changes", KEEPS)
def test_rules_kept_at_their_limit(make: Make, changes: dict[str, Any]) -> None:
    assert_keeps(make(**changes))

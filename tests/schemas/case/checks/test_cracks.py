"""Cracks: cases that break a rule or just keep it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from gimpmd_schemas.case.form import Case
from tests.schemas.case.checks.cases import (
    ALONE,
    BLOCK,
    ENDS,
    MEASURED,
    PAIR,
    Break,
    assert_breaks,
    assert_keeps,
    crack,
    cracked,
    levels,
    regions,
)

Make = Callable[..., Case]

BREAKS: list[Break] = [
    (
        "continuum.cracks[0]",
        regions(*PAIR) | {"continuum__cracks": [{"from": [10, 38], "to": [110, 38]}]},
        "reaches the zones",
    ),
    ("continuum.cracks[0]", {"continuum__cracks": crack(0)}, "has no length"),
    ("continuum.cracks[0]", {"continuum__cracks": crack(-1)}, "leaves the domain"),
    ("continuum.cracks[0]", {"continuum__cracks": crack(62)}, "reaches the zones"),
    ("continuum.cracks[0].along", cracked(along=[0, 1]), "three dimensions"),
    (
        "continuum.cracks[0].along",
        cracked(BLOCK, **{"from": [0, 20, 0], "to": [20, 20, 0]}),
        "missing in three dimensions",
    ),
    (
        "continuum.cracks[0].along",
        cracked(BLOCK, **{"from": [0, 20, 0], "to": [20, 20, 0], "along": [4, 0, 0]}),
        "is parallel",
    ),
    (
        "continuum.cracks[0]",
        cracked(BLOCK, **{"from": [0, 20, 0], "to": [20, 20, 0], "along": [0, 0, 25]}),
        "its end (20, 20, 25) leaves the domain",
    ),
    ("continuum.cracks", cracked() | {"domain__periodic": [True, False]}, "cannot be combined"),
    ("continuum.cracks[0].friction", cracked(friction=0.1), "without contact"),
    ("continuum.cracks[0].friction", cracked(contact="frictional", friction=-1), "negative"),
    (
        "continuum.cracks[1].contact",
        ALONE | {"continuum__cracks": [ENDS, ENDS | {"contact": "frictional"}]},
        "differs from the first crack's",
    ),
    ("continuum.cracks[0].j_radius", cracked(j_radius=7.9), "between 2 cells (8) and 40"),
    ("continuum.cracks[0].j_radius", cracked(j_radius=40.1), "between 2 cells (8) and 40"),
    (  # ends inside level 1
        "continuum.cracks[0]",
        cracked(levels([[[48, 80], [16, 64]]])),
        "comes within 3 cells of the rim of a level",
    ),
    (  # passes level 1's corner, 8 below and 10 to the side: 3 cells are 12
        "continuum.cracks[0]",
        cracked(levels([[[72, 100], [48, 64]]]), to=[62, 40]),
        "comes within 3 cells",
    ),
    (  # 3 cells of 2 are wanted behind the tip; there are 2.9
        "continuum.cracks[0]",
        cracked(levels([[[0, 64], [16, 64]]]), to=[58.2, 40]),
        "comes within 3 cells",
    ),
]

KEEPS: list[dict[str, Any]] = [
    {"only": "continuum", "continuum__cracks": crack(119)},
    {"continuum__cracks": crack(61.9)},  # depth 18.1
    {"continuum__material": MEASURED, "time__md_steps": "auto"},
    regions(*PAIR) | {"continuum__cracks": [{"from": [10, 38], "to": [20, 38]}]},
    cracked(contact="frictional", friction=0.3, j_radius=8),
    cracked(j_radius=40),
    cracked(BLOCK, **{"from": [0, 20, 0], "to": [20, 20, 0], "along": [0, 0, 24]}),
    cracked(levels([[[0, 68], [16, 64]]])),
    cracked(levels([[[72.0, 100], [52.0, 64]]]), to=[60, 40 - 1e-3]),
    cracked(levels([[[0, 64], [16, 64]]]), to=[58, 40]),
]


@pytest.mark.parametrize(("key", "changes", "said"), BREAKS)
def test_broken_rules(make: Make, key: str, changes: dict[str, Any], said: str) -> None:
    assert_breaks(make(**changes), key, said)


@pytest.mark.parametrize("changes", KEEPS)
def test_rules_kept_at_their_limit(make: Make, changes: dict[str, Any]) -> None:
    assert_keeps(make(**changes))

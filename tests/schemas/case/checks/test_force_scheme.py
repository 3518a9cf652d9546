"""What the force scheme needs: cases that break a rule or just keep it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from gimpmd_schemas.case.form import Case
from tests.schemas.case.checks.cases import (
    FORCE,
    PAIR,
    Break,
    assert_breaks,
    assert_keeps,
    planes,
    regions,
)

Make = Callable[..., Case]

BREAKS: list[Break] = [
    (
        "md.regions[1]",
        FORCE | {"md__cutoff": 2.5} | regions(PAIR[0], [[80, 92.9], [20, 52]]),
        "is 12.9 wide along x; ghost atoms",
    ),
    (
        "coupling.planes[1].left",
        FORCE
        | regions(*PAIR)
        | {
            "coupling__planes": [
                {"right": 36, "bottom": 24, "top": 48},
                {"bottom": 24, "top": 48},
            ]
        },
        "missing at an interface",
    ),
    # the force scheme
    *(
        (f"coupling.zones.{name}", FORCE | {f"coupling__zones__{name}": 8}, "velocity scheme;")
        for name in ("incommunicado", "inner", "filter")
    ),
    ("coupling.filter_rate", FORCE | {"coupling__filter_rate": 0}, "velocity scheme; the force"),
    (
        "continuum.interpolation",
        FORCE | {"continuum__interpolation": "cpgimp"},
        "fit the force scheme",
    ),
    (  # two cutoffs and two cells of 4
        "md.region",
        FORCE | {"md__cutoff": 2.5, "md__region": [[0, 80], [20, 32.9]]},
        "is 12.9 wide along y; ghost atoms",
    ),
    ("md.region", FORCE | {"md__region": [[0, 80], [20, 72.1]]}, "within 7.9 of the domain's top"),
    ("coupling.planes.left", planes(left=4), "there is no interface"),
    ("coupling.planes.top", planes(top=None), "missing at an interface"),
    ("coupling.planes.top", planes(top=60), "lies outside md.region"),
    ("coupling.planes", planes(bottom=49), "free atoms less than 2 cells (8) along y"),
    (
        "coupling.planes.top",
        planes(top=69) | {"md__region": [[0, 80], [20, 72]]},
        "comes within 11 of the domain's top face",
    ),
]

KEEPS: list[dict[str, Any]] = [
    {"coupling__scheme": "paper", "md__region": [[0, 80], [16, 64]]},
    FORCE | {"md__cutoff": 4.1},
    FORCE | {"md__cutoff": 2.5, "md__region": [[0, 80], [20, 33]]},
    FORCE | {"md__region": [[0, 80], [20, 72]]},
    FORCE | {"md__cutoff": 2.5} | regions(*PAIR),
    FORCE | regions(*PAIR) | {"only": "md"},
    planes(),
    planes(bottom=48),
    planes(top=68) | {"md__region": [[0, 80], [20, 72]]},
    FORCE | {"only": "continuum", "coupling__filter_rate": 1, "continuum__interpolation": "cpgimp"},
]


@pytest.mark.parametrize(("key", "changes", "said"), BREAKS)
def test_broken_rules(make: Make, key: str, changes: dict[str, Any], said: str) -> None:
    assert_breaks(make(**changes), key, said)


@pytest.mark.parametrize("changes", KEEPS)
def test_rules_kept_at_their_limit(make: Make, changes: dict[str, Any]) -> None:
    assert_keeps(make(**changes))

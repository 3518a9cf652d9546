"""Zones, gaps and absorber: cases that break a rule or just keep it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from gimpmd_schemas.case.form import Case
from tests.schemas.case.checks.cases import (
    ALONE,
    FORCE,
    PAIR,
    Break,
    assert_breaks,
    assert_keeps,
    regions,
)

Make = Callable[..., Case]

BREAKS: list[Break] = [
    (
        "coupling.filter_rate",
        {"coupling__scheme": "paper", "coupling__filter_rate": 1.0},
        "which the scheme paper does not have",
    ),
    (
        "coupling.zones.filter",
        {"coupling__scheme": "paper", "coupling__zones__filter": 8.0},
        "which the scheme paper does not have",
    ),
    (
        "md.regions[1]",
        regions([[0, 60], [20, 60]], [[50, 100], [30, 60]]),
        "overlaps md.regions[0]",
    ),
    (
        "md.regions[1]",
        regions([[0, 50], [20, 60]], [[81, 100], [20, 60]]),
        "only 31 away from md.regi",
    ),
    (
        "md.regions[1]",
        regions([[0, 40], [20, 60]], [[88, 113], [20, 60]]),
        "within 7 of the domain",
    ),
    ("md.regions[2]", regions(*PAIR, [[0, 40], [66, 80]]), "is only 8 away from md.regions[0]"),
    ("coupling.zones", regions(PAIR[0], [[80, 100], [20, 60]]), "do not fit the MD region along x"),
    ("md.region", {"md__region": [[0, 120], [0, 80]]}, "nothing to couple"),
    ("coupling.absorber", {"coupling__absorber": {}}, "belongs to the schemes force"),
    ("coupling.absorber.rate", {"coupling__absorber": {"rate": 0}}, "must be positive"),
    (
        "coupling.absorber.width",
        {"coupling__absorber": {"rate": 1, "width": 0}},
        "must be positive",
    ),
    (
        "coupling.absorber.temperature",
        {"coupling__absorber": {"rate": 1, "temperature": -1}},
        "must not be negative",
    ),
    (
        "coupling.absorber.seed",
        {"coupling__absorber": {"rate": 1, "seed": -1}},
        "must not be negative",
    ),
    ("coupling.zones.outer", {"md__cutoff": 4.01}, "narrower than the potential's cutoff"),
    ("continuum.integrator", {"continuum__integrator": "usavg"}, "does not fit the velocity"),
    ("coupling.zones.inner", {"coupling__zones__inner": 7.9}, "narrower than four layers"),
    ("coupling.zones", {"md__region": [[0, 80], [22, 58]]}, "do not fit the MD region along y"),
    ("md.region", {"md__region": [[0, 80], [20, 72.1]]}, "within 7.9 of the domain's top face"),
    # how it is solved
    ("continuum.integrator", {"continuum__integrator": "usl"}, "does not fit the velocity"),
    ("continuum.integrator", {"continuum__integrator": "usf"}, "does not fit the velocity"),
    ("continuum.integrator", FORCE | {"continuum__integrator": "usavg"}, "fit the force scheme"),
    (
        "coupling.zones.outer",
        FORCE | {"md__cutoff": 2.5, "coupling__zones__outer": 2.4},
        "narrower than the potential's cutoff",
    ),
]

KEEPS: list[dict[str, Any]] = [
    {"md__cutoff": 4.0},
    {"coupling__scheme": "paper", "md__region": [[0, 80], [16, 64]]}
    | {"continuum__integrator": "usl"},
    {"continuum__integrator": "musl"},
    {"only": "continuum", "continuum__integrator": "usavg"},
    {"only": "md", "md__region": [[0, 120], [0, 80]]},
    {"md__region": [[0, 80], [21.9, 58.0]]},  # 36.1 wide; the zones take 36
    {"md__region": [[0, 80], [20, 72]]},  # 8 to the face, two cells
    FORCE | {"md__cutoff": 4.1, "coupling__zones__outer": 4.1},
    regions(*PAIR),
    regions(*PAIR) | {"boundary__top": {"condition": "absorbing"}},
    *(ALONE | {"continuum__integrator": name} for name in ("usf", "usl", "musl", "usavg")),
]


@pytest.mark.parametrize(("key", "changes", "said"), BREAKS)
def test_broken_rules(make: Make, key: str, changes: dict[str, Any], said: str) -> None:
    assert_breaks(make(**changes), key, said)


@pytest.mark.parametrize("changes", KEEPS)
def test_rules_kept_at_their_limit(make: Make, changes: dict[str, Any]) -> None:
    assert_keeps(make(**changes))

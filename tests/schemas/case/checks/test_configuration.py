"""Which schemes of the continuum go together."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from gimpmd_schemas.case.form import Case
from tests.schemas.case.checks.cases import (
    ALONE,
    BLOCK,
    CORRECTED,
    FIXED,
    FORCE,
    FORCED,
    Break,
    assert_breaks,
    assert_keeps,
)

Make = Callable[..., Case]

BREAKS: list[Break] = [
    (
        "continuum.configuration",
        {"coupling__scheme": "paper", "md__region": [[0, 80], [16, 64]]}
        | {"continuum__configuration": "reference"},
        "does not fit the paper scheme",
    ),
    (
        "continuum.interpolation",
        {"continuum__interpolation": "cpgimp"},
        "no effect in the reference configuration",
    ),
    ("continuum.xpic.every", {"continuum__xpic__every": 20}, "would filter only waves"),
    (
        "continuum.dispersion",
        {"continuum__dispersion": "corrected"},
        "cannot be corrected in the velocity scheme",
    ),
    (
        "continuum.configuration",
        FORCED | {"continuum__configuration": "current"},
        "does not fit the force scheme",
    ),
    (
        "continuum.interpolation",
        {"only": "continuum", "continuum__configuration": "reference"}
        | {"continuum__interpolation": "cpgimp"},
        "no effect in the reference configuration",
    ),
    ("continuum.xpic.every", FIXED | {"continuum__xpic__every": 20}, "would filter only waves"),
    (
        "continuum.dispersion",
        ALONE | {"continuum__dispersion": "corrected"},
        "in the reference configuration only",
    ),
    (
        "continuum.integrator",
        CORRECTED | {"continuum__integrator": "usavg"},
        "cannot be combined",
    ),
    (
        "continuum.interpolation",
        CORRECTED | {"continuum__interpolation": "bspline"},
        "has another dispersion",
    ),
]

KEEPS: list[dict[str, Any]] = [
    {"continuum__xpic__every": 0},
    {"continuum__configuration": "current", "continuum__dispersion": "lumped"},
    {"continuum__configuration": "current", "continuum__interpolation": "cpgimp"}
    | {"continuum__xpic__every": 20},
    {"continuum__configuration": "reference"},
    FIXED,
    FIXED | {"continuum__integrator": "usavg", "continuum__xpic__every": 0},
    CORRECTED,
    CORRECTED | {"continuum__interpolation": "linear", "continuum__integrator": "musl"},
    BLOCK | {"continuum__configuration": "reference", "continuum__dispersion": "corrected"},
    FORCE | {"continuum__interpolation": "linear", "continuum__integrator": "musl"},
    FORCE | {"continuum__xpic__every": 0},
    *(ALONE | {"continuum__interpolation": name} for name in ("linear", "bspline", "cpgimp")),
]


@pytest.mark.parametrize(("key", "changes", "said"), BREAKS)
def test_broken_rules(make: Make, key: str, changes: dict[str, Any], said: str) -> None:
    assert_breaks(make(**changes), key, said)


@pytest.mark.parametrize("changes", KEEPS)
def test_rules_kept_at_their_limit(make: Make, changes: dict[str, Any]) -> None:
    assert_keeps(make(**changes))

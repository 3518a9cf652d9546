"""Body force, damping and initial state: cases that break a rule or just keep it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from gimpmd_schemas.case.form import Case
from tests.schemas.case.checks.cases import (
    ALONE,
    BLOCK,
    SKEW,
    SLANTED,
    STIFF,
    Break,
    anisotropic,
    assert_breaks,
    assert_keeps,
    packet,
)

Make = Callable[..., Case]

BREAKS: list[Break] = [
    ("initial.packets[0].wavelength", {"initial__packets": packet(wavelength=0)}, "positive"),
    ("initial.packets[0].cycles", {"initial__packets": packet(cycles=0)}, "positive"),
    (
        "initial.packets[0].center",
        {"initial__packets": packet(center=121)},
        "is outside the domain",
    ),
    (
        "initial.packets[0].center",
        {"initial__packets": packet(center=81, axis=1)},
        "outside the domain",
    ),
    ("initial.packets[0].tilt", {"initial__packets": packet(tilt=81)}, "between -80 and 80"),
    (
        "initial.stretch.gradient",
        {"initial__stretch": {"gradient": [[0.2, 0], [0, 0]]}},
        "must be less than 0.2",
    ),
    (
        "initial.stretch.gradient",
        ALONE
        | {"domain__periodic": [False, True]}
        | {"initial__stretch": {"gradient": [[0, 0.01], [0, 0]]}},
        "displaces one end of the period along y",
    ),
    (
        "initial.packets[0].tilt",
        ALONE | {"domain__periodic": [False, True], "initial__packets": packet(tilt=20)},
        "gives 2.73616 waves over the period along y, not a whole number",
    ),
    (
        "initial.packets[0].tilt",
        BLOCK
        | anisotropic(SKEW.tolist())
        | {"initial__packets": packet(center=20, axis=1, tilt=30)},
        "needs waves that move in the plane of y and z",
    ),
    ("initial.packets[0].axis", ALONE | {"initial__packets": packet(axis=2)}, "no z axis"),
    (
        "initial.packets[0].polarization",
        ALONE | anisotropic(SLANTED) | {"initial__packets": packet()},
        "is not a wave of this stiffness along x",
    ),
    ("continuum.damping[0].rate", {"continuum__damping": [{"rate": -1}]}, "must not be negative"),
    ("continuum.damping[0].flip", {"continuum__damping": [{"flip": -0.1}]}, "must be a fraction"),
    ("continuum.damping[0].box", {"continuum__damping": [{"box": [[0, 1], [1, 0]]}]}, "upper y"),
    ("continuum.body_force", {"continuum__body_force": {"acceleration": [0, 1]}}, "not feel it"),
    (
        "continuum.body_force.ramp",
        ALONE | {"continuum__body_force": {"acceleration": [0, 1], "ramp": -1}},
        "must not be negative",
    ),
    # start
    (
        "initial.velocities[0].box",
        ALONE | {"initial__velocities": [{"velocity": [0, 0], "box": [[1, 0], [0, 1]]}]},
        "upper x is not above",
    ),
    (
        "initial.velocities[0].center",
        ALONE | {"initial__velocities": [{"velocity": [0, 0], "center": [1, 0]}]},
        "without a gradient",
    ),
]

KEEPS: list[dict[str, Any]] = [
    {"domain__periodic": [False, True], "md__region": [[0, 80], [0, 80]]},
    {"initial__packets": packet(center=120)},
    ALONE | anisotropic(STIFF) | {"initial__packets": packet()},
    ALONE | {"initial__packets": packet(tilt=-41.7)},
    ALONE | anisotropic(STIFF) | {"initial__packets": packet(tilt=30)},
    BLOCK | anisotropic(SKEW.tolist()) | {"initial__packets": packet(center=20, tilt=30)},
    ALONE | {"domain__periodic": [False, True], "initial__packets": packet(tilt=30)},
    {"only": "continuum", "continuum__body_force": {"acceleration": [0, 1], "ramp": 1}},
    BLOCK | {"initial__packets": packet(axis=2, center=24, polarization="S")},
    ALONE
    | {
        "initial__velocities": [
            {"velocity": [0, 0], "gradient": [[0, 1], [0, 0]], "center": [1, 2]}
        ]
    },
]


@pytest.mark.parametrize(("key", "changes", "said"), BREAKS)
def test_broken_rules(make: Make, key: str, changes: dict[str, Any], said: str) -> None:
    assert_breaks(make(**changes), key, said)


@pytest.mark.parametrize("changes", KEEPS)
def test_rules_kept_at_their_limit(make: Make, changes: dict[str, Any]) -> None:
    assert_keeps(make(**changes))

"""Loads, faces and initial state: cases that break a rule or just keep it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from gimpmd_schemas.case.form import Case
from tests.schemas.case.checks.cases import (
    ABSORBING,
    ALONE,
    BLOCK,
    LEFT,
    PAIR,
    SLANTED,
    STIFF,
    Break,
    anisotropic,
    assert_breaks,
    assert_keeps,
    face,
    packet,
    regions,
)

Make = Callable[..., Case]

BREAKS: list[Break] = [
    ("boundary.right.condition", regions(*PAIR) | ABSORBING, "is not available for the atoms"),
    ("boundary.left.ramp", {"boundary__left": LEFT | {"ramp": -1}}, "must not be negative"),
    ("boundary.left.stiffness", {"boundary__left": {"condition": "foundation"}}, "positive"),
    (
        "boundary.left.stiffness",
        {"boundary__left": {"condition": "foundation", "stiffness": -0.1}},
        "positive",
    ),
    ("boundary.left.stiffness", {"boundary__left": LEFT | {"stiffness": 0.1}}, "has no stiffness"),
    (
        "boundary.left.ramp",
        {"boundary__left": {"condition": "foundation", "stiffness": 0.1, "ramp": 2.0}},
        "does not change with time",
    ),
    ("boundary.left.value", {"boundary__left": {"condition": "traction"}}, "needs a value"),
    ("boundary.left.value", {"boundary__left": {"condition": "velocity"}}, "needs a value"),
    ("boundary.left.value", {"boundary__left": {"value": [1, 0]}}, "takes no value"),
    (
        "boundary.left.value",
        {"boundary__left": {"condition": "symmetry", "value": [0, None]}},
        "takes no value",
    ),
    (
        "boundary.top.condition",
        {
            "domain__periodic": [False, True],
            "md__region": [[0, 80], [0, 80]],
            "boundary__top": {"condition": "symmetry"},
        },
        "periodic axis",
    ),
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
        ALONE | anisotropic(STIFF) | {"initial__packets": packet(tilt=30)},
        "needs an isotropic body",
    ),
    ("boundary.front", ALONE | {"boundary__front": {"condition": "symmetry"}}, "no front face"),
    ("initial.packets[0].axis", ALONE | {"initial__packets": packet(axis=2)}, "no z axis"),
    (
        "initial.packets[0].polarization",
        ALONE | anisotropic(SLANTED) | {"initial__packets": packet()},
        "is not a wave of this stiffness along x",
    ),
    ("continuum.damping[0].rate", {"continuum__damping": [{"rate": -1}]}, "must not be negative"),
    ("continuum.damping[0].flip", {"continuum__damping": [{"flip": -0.1}]}, "must be a fraction"),
    ("continuum.damping[0].box", {"continuum__damping": [{"box": [[0, 1], [1, 0]]}]}, "upper y"),
    # loads
    ("continuum.body_force", {"continuum__body_force": {"acceleration": [0, 1]}}, "not feel it"),
    (
        "continuum.body_force.ramp",
        ALONE | {"continuum__body_force": {"acceleration": [0, 1], "ramp": -1}},
        "must not be negative",
    ),
    (
        "boundary.left.history",
        face(condition="traction", value=[1, 0], history=[[0, 0], [0, 1]]),
        "do not increase",
    ),
    (
        "boundary.left.ramp",
        face(condition="traction", value=[1, 0], history=[[0, 1]], ramp=1),
        "in addition to a history",
    ),
    ("boundary.left", face(condition="displacement", value=[1, 0]), "must be zero at the start"),
    (
        "boundary.left",
        face(condition="displacement", value=[1, 0], history=[[0, 0.1], [1, 1]]),
        "must be zero at the start",
    ),
    ("boundary.left.value", face(condition="displacement", ramp=1), "needs a value"),
    ("boundary.left.value", face(condition="absorbing", value=[1, 0]), "takes no value"),
    (
        "boundary.left.condition",
        {"boundary__left": {"condition": "absorbing"}},
        "is not available for the atoms",
    ),
    (
        "boundary.right.condition",
        {
            "only": "md",
            "boundary__right": {"condition": "displacement", "value": [1, 0], "ramp": 1},
        },
        "is not available for the atoms",
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
    {"boundary__left": {"condition": "velocity", "value": [None, 0]}},
    {"boundary__left": LEFT},
    {"initial__packets": packet(center=120)},
    ALONE | anisotropic(STIFF) | {"initial__packets": packet()},
    ALONE | {"initial__packets": packet(tilt=-41.7)},
    ALONE | {"domain__periodic": [False, True], "initial__packets": packet(tilt=30)},
    {"only": "continuum", "continuum__body_force": {"acceleration": [0, 1], "ramp": 1}},
    face(condition="displacement", value=[1, None], ramp=1),
    face(condition="displacement", value=[1, None], history=[[0, 0], [1, 1], [2, 0]]),
    face(condition="absorbing"),
    {"boundary__right": {"condition": "absorbing"}},
    BLOCK | {"boundary__front": {"condition": "traction", "value": [0, 0, 1]}},
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

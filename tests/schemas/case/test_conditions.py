"""Conditions on faces: cases that break a rule or just keep it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, get_args

import pytest

from gimpmd_schemas.case.conditions import CONDITIONS, ConditionName, names_of
from gimpmd_schemas.case.form import Case
from tests.schemas.case.checks.cases import (
    ABSORBING,
    ALONE,
    BLOCK,
    LEFT,
    PAIR,
    Break,
    assert_breaks,
    assert_keeps,
    face,
    regions,
)

Make = Callable[..., Case]

LOWER: dict[str, Any] = {"condition": "velocity", "value": [1, None], "extent": [[0, 40]]}
MANY: list[dict[str, Any]] = [LOWER | {"extent": [[2 * k, 2 * k + 2]]} for k in range(17)]
SHEAR: dict[str, Any] = {"profile": "linear", "value": [0, 0], "gradient": [[0, 1], [0, 0]]}
TIP: dict[str, Any] = {"profile": "k-field", "tip": [50, 40], "k1": 1.0}


def parts(*given: dict[str, Any]) -> dict[str, Any]:
    """The left face as a list of parts, in a run of the continuum."""
    return {"only": "continuum", "boundary__left": list(given)}


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
    ("boundary.front", ALONE | {"boundary__front": {"condition": "symmetry"}}, "no front face"),
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
    ("boundary.left[0].extent", parts(LOWER | {"extent": []}), "is missing"),
    ("boundary.left.extent", face(**LOWER), "has one condition"),
    ("boundary.left[0].extent", parts(LOWER | {"extent": [[40, 90]]}), "does not lie on the face"),
    ("boundary.left[0].extent", parts(LOWER | {"extent": [[40, 30]]}), "does not lie on the face"),
    ("boundary.left[0].extent", parts(LOWER | {"extent": [[0, 9], [0, 9]]}), "must have 1 pair"),
    ("boundary.left[1].extent", parts(LOWER, LOWER | {"extent": [[39, 80]]}), "overlaps"),
    ("boundary", parts(*MANY) | {"only": "md"}, "too many parts"),
    ("boundary.left.value.profile", face(condition="velocity", value=TIP), "is a displacement"),
    (
        "boundary.left.value.k1",
        face(condition="displacement", value=TIP | {"k1": 0.0}, ramp=1),
        "is zero",
    ),
    (
        "boundary.left.value.gradient[0]",
        face(condition="velocity", value=SHEAR | {"value": [None, 0]}),
        "leaves free",
    ),
    (
        "boundary.left.value.center",
        face(condition="velocity", value=SHEAR | {"center": [0, 0, 0]}),
        "must have 2 entries",
    ),
    ("boundary.left.value", face(condition="absorbing", value=[1, 0]), "takes no value"),
    (
        "boundary.left.condition",
        {"boundary__left": {"condition": "absorbing"}},
        "is not available for the atoms",
    ),
]

KEEPS: list[dict[str, Any]] = [
    {"boundary__left": {"condition": "velocity", "value": [None, 0]}},
    {"boundary__left": LEFT},
    face(condition="displacement", value=[1, None], ramp=1),
    face(condition="displacement", value=[1, None], history=[[0, 0], [1, 1], [2, 0]]),
    face(condition="absorbing"),
    parts(LOWER, LOWER | {"extent": [[40, 80]]}),
    face(condition="velocity", value=SHEAR),
    face(condition="displacement", value=TIP, ramp=1),
    {"boundary__right": {"condition": "absorbing"}},
    BLOCK | {"boundary__front": {"condition": "traction", "value": [0, 0, 1]}},
]


@pytest.mark.parametrize(("key", "changes", "said"), BREAKS)
def test_broken_rules(make: Make, key: str, changes: dict[str, Any], said: str) -> None:
    assert_breaks(make(**changes), key, said)


@pytest.mark.parametrize("changes", KEEPS)
def test_rules_kept_at_their_limit(make: Make, changes: dict[str, Any]) -> None:
    assert_keeps(make(**changes))


def test_every_condition_has_a_row() -> None:
    """The rows are in the order of the names, which messages list."""
    assert tuple(CONDITIONS) == get_args(ConditionName)


@pytest.mark.parametrize(
    ("field", "said"),
    [
        ("value", "traction, velocity or displacement"),
        ("stiffness", "foundation"),
        ("atoms", "free, traction, velocity, displacement or symmetry"),
    ],
)
def test_conditions_in_words(field: str, said: str) -> None:
    assert names_of(field) == said

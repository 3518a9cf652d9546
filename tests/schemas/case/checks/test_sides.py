"""What each side needs, and one dimension for all."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from gimpmd_schemas.case.form import Case
from tests.schemas.case.checks.cases import (
    ALONE,
    BLOCK,
    FORCE,
    PAIR,
    Break,
    assert_breaks,
    assert_keeps,
    cracked,
    face,
    levels,
    regions,
)

Make = Callable[..., Case]

BREAKS: list[Break] = [
    ("md.region", {"md__region": ...}, "missing"),
    ("md.regions", {"md__regions": [[[0, 16], [20, 60]]]}, "in addition to md.region"),
    (
        "coupling.planes",
        FORCE | regions(*PAIR) | {"coupling__planes": {"right": 36, "bottom": 24, "top": 48}},
        "are not the planes of 2 MD regions",
    ),
    (
        "initial.stretch.center",
        {"initial__stretch": {"gradient": [[0.01, 0], [0, 0]], "center": [1, 2, 3]}},
        "must have 2 entries",
    ),
    # sides and dimensions
    ("md", {"md": ..., "time": {"end": 8}}, "missing, and the run has atoms"),
    ("md", ALONE | {"only": "md"}, "missing, and the run has atoms"),
    ("time.md_timestep", {"time__md_timestep": ...}, "missing"),
    ("time.md_timestep", ALONE | {"time": {"end": 8, "md_timestep": 1e-3}}, "has no md"),
    ("time.md_steps", ALONE | {"time": {"end": 8, "md_steps": 4}}, "has no md"),
    ("time.step", {"time__step": 0.08}, "is determined by the atoms"),
    ("domain.box", {"domain__box": [[0, 120], [0, 80], [0, 8]]}, "three dimensions"),
    ("domain.periodic", {"domain__periodic": [True]}, "must have 2 entries"),
    ("domain.periodic", BLOCK | {"domain__periodic": [True, True]}, "must have 3 entries"),
    ("md.region", {"md__region": [[0, 80], [20, 60], [0, 1]]}, "must have 2 entries"),
    ("grid.levels[0].boxes[0]", levels([[[16, 40]] * 3]), "must have 2 entries"),
    ("continuum.cracks[0].from", cracked(**{"from": [0, 0, 0]}), "must have 2 entries"),
    ("continuum.cracks[0].along", cracked(BLOCK, along=[0, 4]), "must have 3 entries"),
    ("continuum.damping[0].box", ALONE | {"continuum__damping": [{"box": [[0, 1]] * 3}]}, "2 ent"),
    ("boundary.left.value", face(condition="traction", value=[1, 0, 0]), "must have 2 entries"),
    (
        "continuum.body_force.acceleration",
        BLOCK | {"continuum__body_force": {"acceleration": [0, -1]}},
        "must have 3 entries",
    ),
    (
        "initial.velocities[0].gradient[1]",
        ALONE | {"initial__velocities": [{"velocity": [0, 0], "gradient": [[0, 0], [0, 0, 0]]}]},
        "must have 2 entries",
    ),
    ("continuum.patches", BLOCK | {"continuum__patches": [1, 1]}, "must have 3 entries"),
]

KEEPS: list[dict[str, Any]] = [
    ALONE,
    ALONE | {"time": {"end": 8, "step": 0.42}},
]


@pytest.mark.parametrize(("key", "changes", "said"), BREAKS)
def test_broken_rules(make: Make, key: str, changes: dict[str, Any], said: str) -> None:
    assert_breaks(make(**changes), key, said)


@pytest.mark.parametrize("changes", KEEPS)
def test_rules_kept_at_their_limit(make: Make, changes: dict[str, Any]) -> None:
    assert_keeps(make(**changes))

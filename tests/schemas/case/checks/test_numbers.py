"""Sizes and signs of numbers: cases that break a rule or just keep it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from gimpmd_schemas.case.checks.numbers import HUGE
from gimpmd_schemas.case.form import Case
from tests.schemas.case.checks.cases import ALONE, LEFT, Break, assert_breaks, assert_keeps

Make = Callable[..., Case]

BREAKS: list[Break] = [
    ("grid.cell", {"grid__cell": 0.0}, "must be positive"),
    ("grid.cell", {"grid__cell": float("nan")}, "must be a number between"),
    ("time.end", {"time__end": float("inf")}, "must be a number between"),
    ("time.end", {"time__end": 2 * HUGE}, "must be a number between"),
    ("time.md_timestep", {"time__md_timestep": 0.5 / HUGE}, "must be a number between"),
    ("md.variables.a", {"md__variables": {"a": float("nan")}}, "must be a number between"),
    ("boundary.top.value[1]", {"boundary__top": LEFT | {"value": [0, float("inf")]}}, "between"),
    ("time.md_timestep", {"time__md_timestep": 1e-99}, "would take 8e+99 MD steps"),
    ("time.md_timestep", {"time__md_timestep": 1e-9, "time__md_steps": 1}, "coupling steps"),
    ("time.end", {"time__end": -1}, "must be positive"),
    ("time.md_timestep", {"time__md_timestep": 0}, "must be positive"),
    ("time.md_steps", {"time__md_steps": 0}, "must be positive"),
    ("output.interval", {"output__interval": 0}, "must be positive"),
    ("output.energy_interval", {"output__energy_interval": -1}, "must be positive"),
    ("output.interval", {"output__interval": 80.1}, "is longer than the run"),
    ("output.energy_interval", {"output__energy_interval": 80.1}, "is longer than the run"),
    ("grid.points_per_axis", {"grid__points_per_axis": 0}, "must be positive"),
    ("md.ranks", {"md__ranks": 0}, "must be positive"),
    ("md.cutoff", {"md__cutoff": 0}, "must be positive"),
    ("continuum.ranks", {"continuum__ranks": 0}, "must be positive"),
    ("continuum.threads", {"continuum__threads": 0}, "must be positive"),
    ("continuum.xpic.order", {"continuum__xpic__order": 0}, "must be at least 1"),
    ("continuum.xpic.every", {"continuum__xpic__every": -1}, "must not be negative"),
    ("coupling.zones.outer", {"coupling__zones__outer": 0}, "must be positive"),
    ("coupling.zones.inner", {"coupling__zones__inner": -1}, "must be positive"),
    ("coupling.zones.filter", {"coupling__zones__filter": 0}, "must be positive"),
    ("coupling.zones.incommunicado", {"coupling__zones__incommunicado": -0.1}, "negative"),
    ("coupling.filter_rate", {"coupling__filter_rate": -1}, "must not be negative"),
    ("name", {"name": ""}, "name of a folder"),
    ("name", {"name": "../up"}, "name of a folder"),
    ("name", {"name": ".hidden"}, "name of a folder"),
    ("name", {"name": "a/b"}, "name of a folder"),
    ("name", {"name": "a*"}, "name of a folder"),
    ("time.step", ALONE | {"time": {"end": 8, "step": 0.0}}, "must be positive"),
    ("continuum.flip", {"continuum__flip": 1.01}, "must be a fraction"),
]

KEEPS: list[dict[str, Any]] = [
    {"grid__points_per_axis": 4},
    {"grid__points_per_axis": 1, "coupling__zones__inner": 16, "md__region": [[0, 80], [12, 68]]},
    {"coupling__zones__inner": 8.0},
    {"coupling__zones__incommunicado": 0},
    {"coupling__filter_rate": 0},
    {"time__end": 0.002, "output__interval": 0.002},
    {"name": "Mode-1_small.2"},
    {"time__md_steps": 211},
    {"time__md_steps": "auto"},
    {"continuum__flip": 0.0, "continuum__damping": [{"rate": 0, "flip": 1}]},
]


@pytest.mark.parametrize(("key", "changes", "said"), BREAKS)
def test_broken_rules(make: Make, key: str, changes: dict[str, Any], said: str) -> None:
    assert_breaks(make(**changes), key, said)


@pytest.mark.parametrize("changes", KEEPS)
def test_rules_kept_at_their_limit(make: Make, changes: dict[str, Any]) -> None:
    assert_keeps(make(**changes))

"""Time steps: cases that break a rule or just keep it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from gimpmd_schemas.case.checks.check import check_case
from gimpmd_schemas.case.derive.material import wave_speed
from gimpmd_schemas.case.form import Case
from tests.schemas.case.checks.cases import ALONE, Break, assert_breaks, levels

Make = Callable[..., Case]

BREAKS: list[Break] = [
    (
        "coupling.absorber.rate",
        {"coupling__scheme": "force", "coupling__absorber": {"rate": 100}},
        "more than all motion",
    ),
    ("time.md_steps", {"time__md_steps": 212}, "c dt / h"),
    ("time.step", ALONE | {"time": {"end": 8, "step": 0.43}}, "c dt / h"),
    ("time.step", levels([[[16, 40], [16, 40]]]) | {"time": {"end": 8, "step": 0.22}}, "c dt / h"),
]


@pytest.mark.parametrize(("key", "changes", "said"), BREAKS)
def test_broken_rules(make: Make, key: str, changes: dict[str, Any], said: str) -> None:
    assert_breaks(make(**changes), key, said)


def test_cfl_hint_is_stable(make: Make) -> None:
    """The number of steps in the hint is accepted; one more is not."""
    (problem,) = check_case(make(time__md_steps=1000))
    most = int(problem.hint.split()[2])
    assert check_case(make(time__md_steps=most)) == []
    assert check_case(make(time__md_steps=most + 1)) != []
    (problem,) = check_case(make(time__md_timestep=10.0, time__md_steps=1, time__end=100.0))
    assert "enlarge grid.cell" in problem.hint


def test_md_time_step_against_the_lattice(make: Make) -> None:
    limit = 0.5 / (2.31 * wave_speed(make(), "P") / 1.1132)
    short, long = (
        {"time__md_timestep": limit * factor, "time__md_steps": 1} for factor in (0.99, 1.01)
    )
    assert check_case(make(**short), spacing=1.1132) == []
    (problem,) = check_case(make(**long), spacing=1.1132)
    assert problem.key == "time.md_timestep"
    assert check_case(make(**long, only="continuum"), spacing=1.1132) == []

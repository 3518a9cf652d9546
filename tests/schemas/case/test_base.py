"""Values over time: ramps, histories and their means."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gimpmd_schemas.case.conditions import Face


@pytest.mark.parametrize(
    ("ramp", "time", "factor"), [(0, 0, 1), (10, 0, 0), (10, 5, 0.5), (10, 10, 1), (10, 99, 1)]
)
def test_ramp(ramp: float, time: float, factor: float) -> None:
    assert Face(condition="traction", value=(0.0, 1.0), ramp=ramp).factor(time) == factor


def test_history_is_linear_between_and_constant_beyond() -> None:
    face = Face(condition="velocity", value=(1.0, 0.0), history=((1, 2), (3, -2), (4, 0)))
    times = (0, 1, 1.5, 2, 3, 3.5, 4, 9)
    assert [face.factor(t) for t in times] == [2, 2, 1, 0, -2, -1, 0, 0]


@pytest.mark.parametrize(
    "timed", [{}, {"ramp": 0.7}, {"history": ((0.1, 0.0), (0.4, 2.0), (0.5, -1.0))}]
)
@pytest.mark.parametrize(("start", "end"), [(0.0, 1.0), (0.05, 0.45), (0.42, 0.48), (0.9, 2.0)])
def test_mean_factor_is_the_mean(timed: dict[str, Any], start: float, end: float) -> None:
    face = Face(**timed)
    middle = start + (np.arange(10_000) + 0.5) / 10_000 * (end - start)
    # the midpoint rule is exact but for the cells with a corner: 30 / du^2 / 8 < 1e-6
    assert face.mean_factor(start, end) == pytest.approx(
        np.mean([face.factor(t) for t in middle]), abs=1e-6
    )

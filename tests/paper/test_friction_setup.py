"""First slips as outputs at the paper's interval show them, in made-up slips."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_deploy.analysis.slip import SlipHistory
from tests.paper.friction_setup import found_in, shifts


def test_slips_may_come_later_as_long_as_the_same_outputs_show_them() -> None:
    assert shifts(np.array([50.0, 60.0, 70.0])) == pytest.approx((-2.0, 2.0))
    assert shifts(np.array([13.5, 23.8, 31.1, 37.8])) == pytest.approx((34.5, 40.2))
    assert shifts(np.array([50.0, 67.0, 75.0])) is None


def pulses(speed: float, count: int) -> SlipHistory:
    """Steps of a lattice period 1 that run along the plane, ten apart in time, from t = 20."""
    time, position = np.arange(0.0, 80.0, 0.5), np.arange(0.0, 60.0)
    since = time[:, None] - position / speed - 20.0
    slip = np.clip(1.0 + np.floor(since / 10.0), 0.0, count)
    return SlipHistory(time, position, slip, np.gradient(slip, 0.5, axis=0), 0.0 * slip, 1.0)


def test_first_slips_and_speed_of_the_first_pulse() -> None:
    found = found_in(pulses(2.0, 4))
    assert found.first[:3] == pytest.approx([20.0, 30.0, 40.0], abs=0.5)
    assert found.speed == pytest.approx(2.0, abs=1.0 / 16.0 + 1e-9)
    assert found.rate == pytest.approx(1.0)


def test_a_run_that_hardly_slips_has_no_shift() -> None:
    found = found_in(pulses(2.0, 1))
    assert found.first.size == 1
    assert found.shifts is None

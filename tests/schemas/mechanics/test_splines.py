"""Cubics on the intervals of a table."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_schemas.mechanics.splines import cubics, interpolate

STEP = 0.2
POINTS = STEP * np.arange(12)


def cubic(x: np.ndarray) -> np.ndarray:
    return np.asarray(1.0 + x - 3.0 * x**2 + 2.0 * x**3)


def test_a_cubic_is_found_again_away_from_the_ends() -> None:
    x = np.linspace(2.0 * STEP, 9.0 * STEP, 50)
    table = cubics(cubic(POINTS))
    np.testing.assert_allclose(interpolate(table, STEP, x), cubic(x), rtol=1e-13)


def test_values_and_slopes_are_continuous() -> None:
    values = np.random.default_rng(0).standard_normal(12)
    a, b, c, d = cubics(values).T
    np.testing.assert_array_equal(d, values[:-1])
    np.testing.assert_allclose((a + b + c + d)[:-1], values[1:-1], atol=1e-14)
    np.testing.assert_allclose((3.0 * a + 2.0 * b + c)[:-1], c[1:], atol=1e-14)


def test_slopes_at_the_ends_are_one_sided() -> None:
    values = POINTS**2 / STEP**2
    a, b, c, _ = cubics(values).T
    assert c[0] == pytest.approx(1.0)
    assert c[1] == pytest.approx(2.0)
    assert 3.0 * a[-1] + 2.0 * b[-1] + c[-1] == pytest.approx(11.0**2 - 10.0**2)


def test_beyond_the_end_the_last_value_counts() -> None:
    table = cubics(cubic(POINTS))
    assert interpolate(table, STEP, np.array(99.0)) == pytest.approx(cubic(POINTS)[-1])

"""Mach lines of made-up pulses whose angles are known."""

import numpy as np
import pytest

from gimpmd_deploy.analysis.mach import mach_angle
from gimpmd_deploy.analysis.plane import Plane
from tests.deploy.analysis.fields import hexagonal, particles, turned

SITES = hexagonal(((0, 160), (-60, 60)))


def wings(angle, noise=0.0, turn=0.0, background=0.0):
    """Three pulses with wings: ``v = sign(y) f(x + |y| / tan(angle) - x0)``.

    The sign changes across the plane, as the two plates move in opposite directions.
    """
    x, y = SITES.T
    v = sum(np.exp(-(((x + np.abs(y) / np.tan(angle) - x0) / 3.0) ** 2)) for x0 in (150, 120, 90))
    v = np.sign(y) * (v + background * np.abs(y) / 60.0)
    v = v + noise * np.random.default_rng(5).standard_normal(v.size)
    velocity = np.stack([v, 0.0 * v], axis=1)
    return particles(turned(SITES, turn), None, turned(velocity, turn))


def measured(atoms, turn=0.0, **more):
    plane = Plane.through((0, 0), (np.cos(turn), np.sin(turn)))
    return mach_angle(atoms, plane, (10.0, 150.0), (5.0, 50.0), **more)


@pytest.mark.parametrize("degrees", [25.0, 45.0, 57.0, 80.0])
def test_the_angle_of_the_wings(degrees):
    found = measured(wings(np.radians(degrees)))
    assert (found.above, found.below) == pytest.approx((degrees, degrees), abs=0.7)
    assert found.mean == pytest.approx(degrees, abs=0.5)
    assert max(found.spread_above, found.spread_below) < 5.0
    assert found.share > 0.9


@pytest.mark.parametrize("turn", [0.0, 0.5])
def test_noise_and_a_smooth_background(turn):
    """Noise of a fifth of the pulses, and shear of the plates away from the plane."""
    atoms = wings(np.radians(45.0), noise=0.2, turn=turn, background=1.0)
    found = measured(atoms, turn)
    assert found.mean == pytest.approx(45.0, abs=1.5)
    assert found.share > 0.4


def test_the_speed_of_the_source():
    found = measured(wings(np.arcsin(5.4654 / 8.0)))
    assert found.speed(5.4654) == pytest.approx(8.0, rel=0.01)


def test_lines_that_lean_forward():
    found = measured(wings(np.radians(120.0)))
    assert found.mean == pytest.approx(120.0, abs=0.7)


def test_parts_without_lines():
    still = particles(SITES)
    with pytest.raises(ValueError, match="no moving atoms"):
        measured(still)
    with pytest.raises(ValueError, match="too small"):
        mach_angle(still, Plane.through((0, 0), (1, 0)), (0.0, 3.0), (5.0, 50.0))

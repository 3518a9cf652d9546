"""Slip of made-up plates: pulses whose times, speeds and lengths are known."""

import numpy as np
import pytest

from gimpmd_deploy.analysis.plane import Plane
from gimpmd_deploy.analysis.slip import (
    pulse_speed,
    row_profile,
    sliding_patches,
    slip_events,
    slip_history,
    stick_slip,
)
from tests.deploy.analysis.fields import SPACING, MadeUpRun, hexagonal, particles, turned

SITES = hexagonal(((0, 200), (-4, 4)))
PLANE = Plane.through((0, 0), (1, 0))
SPEED, WIDTH = 3.2, 2.0
STARTS = (5.0, 13.0, 21.0)


def pulses(time, x, starts=STARTS):
    """Slip to the left by one period at each pulse, ``-a f((c (t - t0) - x) / w)``; its rate."""
    behind = [(SPEED * (time - start) - x) / WIDTH for start in starts]
    slip = -SPACING * sum(0.5 * (1.0 + np.tanh(one)) for one in behind)
    rate = -SPACING * SPEED / WIDTH * sum(0.5 / np.cosh(one) ** 2 for one in behind)
    return slip, rate


def plates(time, angle=0.0, noise=0.0, motion=pulses):
    """Each plate takes half of the slip; both move along together by any amount."""
    slip, rate = motion(time, SITES[:, 0])
    side = 0.5 * np.sign(SITES[:, 1])
    u = np.stack([side * slip + 0.3 * time, 0.0 * slip], axis=1)
    v = np.stack([side * rate + 0.3, 0.0 * slip], axis=1)
    random = np.random.default_rng(3).standard_normal((2, *SITES.shape))
    u, v = u + noise * random[0], v + noise * random[1]
    return particles(*(turned(field, angle) for field in (SITES, u, v)), time=time)


def history(times, angle=0.0, **more):
    plane = Plane.through((0, 0), (np.cos(angle), np.sin(angle)))
    return slip_history(MadeUpRun(times, lambda t: plates(t, angle, **more)), plane)


TIMES = np.arange(0.0, 45.0, 1.0)


@pytest.mark.parametrize("angle", [0.0, 0.6])
def test_slip_and_rate_are_those_of_the_plates(angle):
    found = history([20.0, 30.0], angle)
    assert found.period == pytest.approx(SPACING)
    assert found.slip.shape == (2, found.position.size)
    slip, rate = pulses(30.0, found.position)
    # neighbours below stand half a period aside: their mean is off by curvature a^2 / 16
    assert found.slip[1] == pytest.approx(slip, abs=0.02 * SPACING)
    assert found.rate[1] == pytest.approx(rate, abs=0.04 * np.abs(rate).max())
    assert np.abs(found.opening).max() < 1e-12


def test_a_part_of_the_plane():
    whole = history([20.0, 30.0])
    part = whole.between(50.0, 80.0)
    assert part.position[0] >= 50.0
    assert part.position[-1] <= 80.0
    inside = (whole.position >= 50.0) & (whole.position <= 80.0)
    assert (part.rate == whole.rate[:, inside]).all()
    assert part.period == whole.period


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_times_and_speed_of_three_pulses(noise):
    events = slip_events(history(TIMES, noise=noise))
    assert events.time.shape[0] == 3
    for number, start in enumerate(STARTS, 1):
        fit = pulse_speed(events.between(20.0, 60.0), number)
        assert fit.speed == pytest.approx(SPEED, abs=max(0.02, 3.0 * fit.error))
        assert fit.error < 0.01 * SPEED
        assert fit.start == pytest.approx(start, abs=0.15)
        assert fit.atoms == 36
    assert events.first == pytest.approx(STARTS, abs=0.3)
    assert events.origin == pytest.approx([0.0] * 3, abs=2.0 * SPACING)
    table = events.to_dataframe()
    assert len(table) == np.isfinite(events.time).sum()
    assert set(table["number"]) == {1, 2, 3}


def test_a_pulse_that_runs_backward_has_a_negative_speed():
    events = slip_events(history(TIMES, motion=lambda t, x: pulses(t, 150.0 - x, STARTS[:1])))
    assert pulse_speed(events.between(20, 130)).speed == pytest.approx(-SPEED, rel=0.01)


def test_no_slip_has_no_speed():
    events = slip_events(history([0.0, 1.0], motion=lambda t, x: (0.0 * x, 0.0 * x)))
    assert events.time.shape[0] == 0
    with pytest.raises(ValueError, match="passed 0 atoms"):
        pulse_speed(events)


def test_atoms_stick_between_pulses():
    found = history(TIMES)
    patches = sliding_patches(found, 30)
    fronts = [SPEED * (30.0 - start) for start in STARTS[::-1]]
    assert [0.5 * (patch.start + patch.end) for patch in patches] == pytest.approx(fronts, abs=1.0)
    # sech^2 falls to a quarter of its peak at acosh(2)
    assert [patch.end - patch.start for patch in patches] == pytest.approx(
        [2.0 * WIDTH * np.arccosh(2.0)] * 3, abs=1.5 * SPACING
    )
    assert patches[0].rate == pytest.approx(0.5 * SPACING * SPEED / WIDTH, rel=0.1)


def test_pulses_heal():
    found = stick_slip(history(TIMES, motion=lambda t, x: pulses(t, x, STARTS[:1])))
    late = found.time > 20.0
    assert (found.patches[late] == 1).all()
    assert np.ptp(found.longest[late]) <= 2.0 * SPACING
    assert found.slipped[-1] == pytest.approx(SPEED * (found.time[-1] - STARTS[0]), abs=2.0)
    assert found.sliding[-1] < 0.03
    assert found.behind[-1] < 0.05
    assert len(found.to_dataframe()) == found.time.size


def crack_like(time, x):
    """Slides at a constant rate everywhere behind the front."""
    since = np.maximum(time - 5.0 - x / SPEED, 0.0)
    return -0.5 * since, -0.5 * (since > 0.0)


def test_a_crack_like_rupture_does_not_heal():
    found = stick_slip(history(TIMES, motion=crack_like))
    assert found.longest[-1] == pytest.approx(SPEED * (found.time[-1] - 5.0), abs=2.0)
    assert found.longest[-1] > 2.0 * found.longest[20]
    assert found.sliding[-1] == pytest.approx(1.0)
    assert np.isnan(found.behind[-1])


def test_the_row_above_the_plane():
    atoms = plates(30.0)
    profile = row_profile(atoms, PLANE)
    rate = pulses(30.0, profile.position)[1]
    assert profile.velocity == pytest.approx(0.3 + 0.5 * rate)
    assert profile.relative_velocity == pytest.approx(rate, abs=0.04 * np.abs(rate).max())
    assert profile.potential_energy is None
    atoms = particles(SITES, potential_energy=-3.0 - SITES[:, 0])
    assert row_profile(atoms, PLANE).potential_energy == pytest.approx(-3.0 - profile.position)


def test_a_plane_beside_the_atoms():
    with pytest.raises(ValueError, match="both sides"):
        row_profile(particles(SITES), Plane.through((0, 90), (1, 0)))

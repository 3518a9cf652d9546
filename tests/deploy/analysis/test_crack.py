"""Crack tip and growth of made-up cracks whose tips are known."""

from types import SimpleNamespace

import numpy as np
import pytest

from gimpmd_deploy.analysis.crack import Crack, crack_growth, crack_of, crack_tip
from gimpmd_schemas.errors import InputError
from tests.deploy.analysis.fields import SPACING, MadeUpRun, hexagonal, particles, turned

SITES = hexagonal(((0, 120), (-15, 15)))
CRACK = Crack.between((0, 0), (40, 0))
GAP = 0.6 * SPACING


def opened(tip, gap=GAP, sites=SITES):
    """Faces moved apart behind the tip: by ``gap`` at once, as across a broken bond."""
    behind = sites[:, 0] < tip
    return np.stack([0.0 * tip * sites[:, 0], 0.5 * gap * np.sign(sites[:, 1]) * behind], axis=1)


def noise(amplitude):
    return amplitude * np.random.default_rng(7).standard_normal(SITES.shape)


@pytest.mark.parametrize("angle", [0.0, 0.5, 2.5])
@pytest.mark.parametrize("tip", [40.0, 41.3, 77.7])
def test_the_tip_is_found_in_every_direction(angle, tip):
    crack = Crack.between((3.0, 2.0), (3.0 + 40 * np.cos(angle), 2.0 + 40 * np.sin(angle)))
    u = opened(tip) + noise(0.03)
    atoms = particles(turned(SITES, angle) + crack.plane.origin, turned(u, angle))
    found = crack_tip(atoms, crack)
    assert tip - SPACING <= found.length <= max(tip, 40.0)
    assert crack.plane.position(found.reference) == pytest.approx(found.length, abs=SPACING)
    assert abs(crack.plane.height(found.reference)) < SPACING


def test_the_square_root_opening_of_a_crack():
    """The opening passes the threshold behind the elastic tip, at a distance that is known."""
    scale = 0.25  # opening = 2 scale sqrt(distance)
    behind = np.maximum(70.0 - SITES[:, 0], 0.0)
    u = np.stack([0.0 * behind, scale * np.sign(SITES[:, 1]) * np.sqrt(behind)], axis=1)
    # two rows, half an atom apart, are separated when the opening reaches this
    opening = SPACING * (np.sqrt(1.3**2 - 0.25) - np.sqrt(0.75))
    expected = 70.0 - (0.5 * opening / scale) ** 2
    assert crack_tip(particles(SITES, u), CRACK).length == pytest.approx(expected, abs=SPACING)


def test_the_position_moves_with_the_body():
    angle, shift = 0.4, np.array([100.0, -30.0])
    now = turned(SITES + opened(60.0), angle) + shift
    found = crack_tip(particles(SITES, now - SITES), CRACK)
    assert 60.0 - SPACING <= found.length <= 60.0
    where = turned(found.reference[None], angle)[0] + shift
    assert found.position == pytest.approx(where, abs=SPACING)


def test_slip_along_the_plane_is_no_crack():
    for slip in (0.25, 0.5, 1.0, 7.5):
        u = np.stack([0.5 * slip * SPACING * np.sign(SITES[:, 1]), 0.0 * SITES[:, 0]], axis=1)
        assert crack_tip(particles(SITES, u), CRACK).length == 40.0


def test_closed_faces_of_the_initial_crack_count_as_open():
    assert crack_tip(particles(SITES), CRACK).length == 40.0


def test_bridges_belong_to_the_crack_and_voids_far_ahead_do_not():
    tip = 60.0
    closed = opened(tip)
    bridge = np.abs(SITES[:, 0] - 50.0) < 0.6 * SPACING
    closed[bridge] = 0.0
    void = np.abs(SITES[:, 0] - 90.0) < 2.0
    closed[void, 1] = 0.5 * GAP * np.sign(SITES[void, 1])
    atoms = particles(SITES, closed)
    assert tip - SPACING <= crack_tip(atoms, CRACK).length <= tip
    assert crack_tip(atoms, CRACK, bridge=1.0).length < 50.0
    assert crack_tip(atoms, CRACK, bridge=40.0).length == pytest.approx(92.0, abs=SPACING)


def test_the_threshold_hardly_matters():
    behind = np.maximum(70.0 - SITES[:, 0], 0.0)
    u = np.stack([0.0 * behind, 0.4 * np.sign(SITES[:, 1]) * np.sqrt(behind)], axis=1)
    tips = [crack_tip(particles(SITES, u), CRACK, stretch=s).length for s in (1.2, 1.3, 1.5)]
    assert max(tips) - min(tips) <= 1.5 * SPACING


def test_a_crack_that_leaves_its_plane():
    """At x = 50 the crack turns upward by 60 degrees, along a row of atoms, to x = 57."""
    left = (SITES[:, 1] - 0.0 > np.sqrt(3.0) * (SITES[:, 0] - 50.0)) & (SITES[:, 1] > 0)
    behind = left & (SITES[:, 0] < 57.0)
    u = 0.0 * SITES
    u[behind] = 2.0 * GAP * np.array([-np.sin(np.pi / 3), np.cos(np.pi / 3)])
    found = crack_tip(particles(SITES, u), CRACK)
    assert found.length == pytest.approx(57.0, abs=SPACING)
    assert found.reference[1] == pytest.approx(np.sqrt(3.0) * 7.0, abs=2.5 * SPACING)


def test_dislocations_are_no_crack():
    """Slip by one period along a row at 60 degrees from the tip, which ends in the crystal."""
    along = np.array([0.5, np.sqrt(0.75)])
    s, h = (SITES - (60.0, 0.0)) @ along, (SITES - (60.0, 0.0)) @ (-along[1], along[0])
    core = 6.0
    slip = SPACING * (0.5 + np.arctan2(s - core, 1.5) / -np.pi)  # a wide core at s = 6
    u = 0.5 * np.sign(h)[:, None] * slip[:, None] * along
    u[h == 0.0] = 0.0
    assert crack_tip(particles(SITES, u), CRACK).length == 40.0


def test_three_dimensions():
    """A crack on a cube face of an fcc crystal; an atom of the face loses four of twelve bonds."""
    n = np.stack(np.meshgrid(np.arange(40), np.arange(12), np.arange(8), indexing="ij"), axis=-1)
    sites = n.reshape(-1, 3)[n.reshape(-1, 3).sum(axis=1) % 2 == 0] - np.array([0.0, 5.5, 0.0])
    u = np.zeros_like(sites)
    u[:, 1] = 0.4 * np.sign(sites[:, 1]) * (sites[:, 0] < 20.5)
    crack = Crack.between((0, 0, 0), (9, 0, 0), normal=(0, 1, 0))
    assert crack_tip(particles(sites, u, size=np.sqrt(2.0)), crack).length == pytest.approx(
        20.0, abs=np.sqrt(2.0)
    )


SPEED, START, STOP = 2.0, 8.0, 20.0


def tip_at(time):
    return 40.0 + SPEED * (np.clip(time, START, STOP) - START)


def growing(times):
    return MadeUpRun(times, lambda t: particles(SITES, opened(tip_at(t)) + noise(0.02), time=t))


def test_growth_starts_and_ends():
    growth = crack_growth(growing(np.arange(0.0, 30.5, 0.5)), CRACK)
    assert np.abs(growth.length - tip_at(growth.time)).max() <= SPACING
    # the tip is known to one atom, which it passes in half a unit of time
    assert growth.start == pytest.approx(START, abs=1.2)
    assert growth.arrest == pytest.approx(STOP, abs=1.2)
    assert growth.speed(6.0)[28] == pytest.approx(SPEED, rel=0.1)
    assert abs(growth.speed(6.0)[4]) < 0.1 * SPEED
    assert growth.position.shape == (61, 2)
    assert list(growth.to_dataframe()) == ["time", "length", "position_x", "position_y"]


def test_the_growth_of_a_crack_that_closes_again():
    def tip(time):
        return tip_at(time) - 4.0 * SPEED * np.clip(time - 24.0, 0.0, 6.0)

    times = np.arange(0.0, 36.5, 0.5)
    run = MadeUpRun(times, lambda t: particles(SITES, opened(tip(t)) + noise(0.02), time=t))
    growth = crack_growth(run, CRACK)
    assert growth.length[-1] == growth.length[0]
    assert growth.start == pytest.approx(START, abs=1.2)
    assert growth.arrest == pytest.approx(STOP, abs=1.2)


def test_growth_without_start_or_end():
    still = crack_growth(growing([0.0, 2.0, 4.0]), CRACK)
    assert still.start is None
    assert still.arrest is None
    going = crack_growth(growing([0.0, 8.0, 12.0, 16.0]), CRACK)
    assert going.start == 8.0
    assert going.arrest is None


def test_the_crack_of_a_run():
    line = SimpleNamespace(start=(0.0, 0.0), end=(30.0, 40.0), along=None)
    plan = SimpleNamespace(continuum=SimpleNamespace(cracks=(line,)))
    run = SimpleNamespace(plan=plan, folder="runs/a")
    crack = crack_of(run)
    assert crack.length == 50.0
    assert crack.plane.along == pytest.approx((0.6, 0.8))
    with pytest.raises(InputError, match=r"Crack\.between"):
        crack_of(run, 1)

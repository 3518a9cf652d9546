"""Regions in which velocities decay, or are taken from the grid in part (PIC)."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.laws import LinearElastic
from gimpmd_gimp.points.distribution import fill
from gimpmd_gimp.step.damping import DampingRegion
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver

SOFT = LinearElastic(1.0, 1e-12, 1e-12)
BODY = LinearElastic(1.0, 1.0 / 3.0, 1.0 / 3.0)
INTEGRATORS = ["usavg", "musl", "usl", "usf"]


def bar(integrator, *regions, law=BODY, finer=(), cells=32, per_cell=2):
    h = Hierarchy((0.0, 0.0), 1.0, (cells, 2), (True, True), finer)
    mesh = Mesh(h)
    method = Method(integrator, xpic_every=0, damping=regions)
    return Solver(mesh, fill(mesh, per_cell, 1.0), law, method, 0.25 / 2**h.top)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_uniform_velocity_decays_exponentially(integrator):
    """Exact: ``v = v_0 exp(-rate t)``, with t the time of the velocities."""
    solver = bar(integrator, DampingRegion(rate=0.3))
    solver.points.v[:] = (1e-3, 2e-3)
    for _ in range(40):
        solver.step()
    exact = np.exp(-0.3 * solver.clock.velocity_time[0])
    assert solver.clock.velocity_time[0] == pytest.approx(10.0, abs=0.126)
    assert solver.points.v[:, 0] == pytest.approx(1e-3 * exact, rel=1e-12)
    assert solver.points.v[:, 1] == pytest.approx(2e-3 * exact, rel=1e-12)


@pytest.mark.parametrize("integrator", ["usavg", "musl"])
def test_a_body_that_is_slowed_comes_as_far_as_it_must(integrator):
    """Exact: ``u = v_0 (1 - exp(-rate t)) / rate``; the mean velocities of the steps are of second
    order, with an error of ``(rate dt)^2 / 12`` (trapezoidal rule) or half of it (midpoint rule).
    """
    rate, dt = 0.3, 0.25
    solver = bar(integrator, DampingRegion(rate=rate))
    p = solver.points
    p.v[:] = (1e-3, 0.0)
    for _ in range(40):
        solver.step()
    exact = 1e-3 * (1.0 - np.exp(-rate * 40 * dt)) / rate
    assert p.x[:, 0] - p.reference[:, 0] == pytest.approx(exact, rel=1.1 * (rate * dt) ** 2 / 12.0)


@pytest.mark.parametrize("integrator", ["usavg", "musl"])
def test_levels_decay_together(integrator):
    """Levels take their steps of decay at different times; at this rate that costs 0.4 %."""
    solver = bar(integrator, DampingRegion(rate=0.3), finer=((((16, 48), (0, 4)),),))
    solver.points.v[:] = (1e-3, 2e-3)
    for _ in range(80):
        solver.step()
    exact = np.exp(-0.3 * solver.clock.velocity_time[solver.points.level])
    assert solver.points.v[:, 0] == pytest.approx(1e-3 * exact, rel=0.006)
    assert solver.points.v[:, 1] == pytest.approx(2e-3 * exact, rel=0.006)


@pytest.mark.parametrize("integrator", ["usavg", "musl"])
def test_a_standing_wave_decays_at_half_the_rate(integrator):
    """A weakly damped oscillator: amplitude ``exp(-rate t / 2)``; both energies in turn."""
    rate, k = 0.02, 2.0 * np.pi / 32.0
    solver = bar(integrator, DampingRegion(rate=rate))
    solver.points.v[:, 0] = 1e-4 * np.sin(k * solver.points.reference[:, 0])

    def period_mean():
        start, total = solver.time, 0.0
        while solver.time < start + 32.0 - 1e-9:
            solver.step()
            total += solver.energies()[:2].sum()
        return total

    first = period_mean()
    period_mean()
    assert period_mean() / first == pytest.approx(np.exp(-rate * 64.0), rel=0.01)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("finer", [(), ((((16, 48), (0, 4)),),)])
def test_what_damping_takes_counts_as_dissipated(integrator, finer):
    """Kick and decay take turns: what is missing of it is below rate times dt."""
    rate, dt = 0.02, 0.25
    solver = bar(integrator, DampingRegion(rate=rate), finer=finer)
    solver.points.v[:, 0] = 1e-3 * np.sin(2.0 * np.pi / 32.0 * solver.points.reference[:, 0])
    before = solver.tally()
    while solver.time < 40.0 - 1e-9:
        solver.step()
    after = solver.tally()
    lost = before.kinetic + before.potential - after.kinetic - after.potential
    assert lost > 0.5 * before.kinetic
    assert after.dissipated == pytest.approx(lost, rel=rate * dt)


def weight(distance, half):
    """GIMP weight of a node for a point, paper Eq. 9: the hat averaged over the point, by sums."""
    x = distance + half * (np.arange(2000) + 0.5) / 1000.0 - half
    return np.maximum(1.0 - np.abs(x), 0.0).mean()


def grid_factor(k, per_cell):
    """What points to nodes, nodes to points and back makes of the grid's wave ``exp(i k x)``."""
    half = 0.5 / per_cell
    points = (np.arange(-2 * per_cell, 2 * per_cell) + 0.5) / per_cell
    nodes = np.arange(-4, 5)
    S = np.array([[weight(x - node, half) for node in nodes] for x in points])
    own = S[:, 4]
    return float((own @ S @ np.cos(k * nodes)) / own.sum())


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("flip", [0.0, 0.9])
@pytest.mark.parametrize("per_cell", [1, 2])
def test_pic_damps_a_wave_as_its_weights_have_it(integrator, flip, per_cell):
    """Exact, without forces: the grid's wave shrinks by ``flip + (1 - flip) g(k)`` a kick."""
    k = 2.0 * np.pi / 8.0
    solver = bar(integrator, DampingRegion(flip=flip), law=SOFT, per_cell=per_cell)
    solver.points.v[:, 1] = 1e-9 * np.sin(k * solver.points.reference[:, 0])
    solver.stages.project()
    node = solver.mesh.find(0, np.array([[2, 0]]))[0]
    before, kicks = solver.V[node, 1], 12
    for _ in range(kicks):
        solver.step()
    solver.stages.project()
    factor = flip + (1.0 - flip) * grid_factor(k, per_cell)
    assert factor < 0.99
    assert solver.V[node, 1] / before == pytest.approx(factor**kicks, rel=1e-6)


def test_a_region_damps_nothing_beyond_it():
    """Regions go by reference positions; later ones win."""
    solver = bar(
        "usavg",
        DampingRegion(rate=0.5),
        DampingRegion(((16.0, 32.0), (0.0, 2.0)), rate=0.1),
        law=SOFT,
        cells=32,
    )
    solver.points.v[:, 1] = 1e-9
    for _ in range(20):
        solver.step()
    X, v = solver.points.reference[:, 0], solver.points.v[:, 1]
    left = (X > 4.0) & (X < 12.0)
    right = (X > 20.0) & (X < 28.0)
    assert v[left] == pytest.approx(1e-9 * np.exp(-0.5 * 5.0), rel=1e-6)
    assert v[right] == pytest.approx(1e-9 * np.exp(-0.1 * 5.0), rel=1e-6)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_momentum_outlives_pic(integrator):
    solver = bar(integrator, DampingRegion(flip=0.3))
    rng = np.random.default_rng(5)
    solver.points.v[:] = 1e-3 + 1e-4 * rng.standard_normal((solver.points.count, 2))
    before, energy = solver.points.mass @ solver.points.v, solver.energies()[:2].sum()
    for _ in range(30):
        solver.step()
    assert solver.points.mass @ solver.points.v == pytest.approx(before, rel=1e-12)
    assert solver.energies()[:2].sum() < energy

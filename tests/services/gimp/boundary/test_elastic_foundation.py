"""An elastic foundation against closed forms.

A column of height H on springs of stiffness k, free at the other end, has the modes
``u = cos(q (H - y))`` with ``q tan(q H) = k / M`` and the frequency ``q sqrt(M / rho)``, where M is
the modulus of its waves: ``lame + 2 shear`` along the column, ``shear`` across it.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from gimpmd_gimp.boundary.elastic_foundation import ElasticFoundation
from gimpmd_gimp.boundary.traction import Traction
from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.laws import Law, LinearElastic, NeoHookean
from gimpmd_gimp.points.distribution import fill
from gimpmd_gimp.step.damping import DampingRegion
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver

HEIGHT, STIFFNESS = 16, 0.05
LINEAR = LinearElastic(1.0, 1.0 / 3.0, 1.0 / 3.0)
MODULUS = {0: 1.0 / 3.0, 1: 1.0}
"""Of motion across and along the column."""


def column(
    method: Method, *more: Traction, law: Law = LINEAR, side: int = 0, finer: tuple = ()
) -> tuple[Solver, ElasticFoundation]:
    """A column along y, periodic along x, on a foundation at its lower or upper end."""
    hierarchy = Hierarchy((0.0, 0.0), 1.0, (4, HEIGHT), (True, False), finer)
    mesh = Mesh(hierarchy)
    foundation = ElasticFoundation(1, side, STIFFNESS)
    points, dt = fill(mesh, 2, 1.0), 0.2 / 2**hierarchy.top
    solver = Solver(mesh, points, law, method, dt, conditions=[foundation, *more])
    return solver, solver.conditions[0]


def wave_number(component: int) -> float:
    """Of the first mode."""
    ratio = STIFFNESS / MODULUS[component]
    return brentq(lambda q: q * np.tan(q * HEIGHT) - ratio, 1e-6, 0.5 * np.pi / HEIGHT - 1e-9)


@pytest.mark.parametrize("integrator", ["usavg", "musl"])
@pytest.mark.parametrize("configuration", ["current", "reference"])
@pytest.mark.parametrize(("component", "side"), [(1, 0), (1, 1), (0, 0)])
def test_period_of_the_first_mode(integrator, configuration, component, side):
    solver, _ = column(Method(integrator, xpic_every=0, configuration=configuration), side=side)
    p, q = solver.points, wave_number(component)
    y = p.reference[:, 1]
    shape = np.cos(q * (HEIGHT - y if side == 0 else y))
    p.v[:, component] = 1e-4 * shape
    mode, times = [], []
    period = 2.0 * np.pi / (q * MODULUS[component] ** 0.5)
    while solver.time < 1.1 * period:
        solver.step()
        y = solver.points.reference[:, 1]
        shape = np.cos(q * (HEIGHT - y if side == 0 else y))
        mode.append(float(solver.points.mass @ (solver.points.v[:, component] * shape)))
        times.append(solver.clock.velocity_time[0])
    turn = np.flatnonzero(np.diff(np.sign(mode)) != 0)
    zeros = [times[i] + (times[i + 1] - times[i]) * mode[i] / (mode[i] - mode[i + 1]) for i in turn]
    assert 2.0 * (zeros[1] - zeros[0]) == pytest.approx(period, rel=1e-3)


@pytest.mark.parametrize(
    ("method", "law", "finer"),
    [
        (Method("musl", configuration="reference"), LINEAR, ()),
        (Method("musl", configuration="reference"), NeoHookean(1.0, 1.0 / 3.0, 1.0 / 3.0), ()),
        (Method("usavg", configuration="reference"), LINEAR, ((((0, 8), (0, 16)),),)),
        (Method("usavg", xpic_every=0), LINEAR, ()),
    ],
    ids=["linear", "finite", "levels", "current"],
)
def test_energy_of_the_springs_is_minus_the_external_work(method, law, finer):
    solver, foundation = column(method, law=law, finer=finer)
    q = wave_number(1)
    solver.points.v[:, 1] = 0.01 * np.cos(q * (HEIGHT - solver.points.reference[:, 1]))
    start = solver.energies()[:2].sum()
    largest = 0.0
    for _ in range(200):
        for _ in range(2**solver.top):
            solver.step()
        held = solver.energies()[:2].sum()
        stored = foundation.energy()
        largest = max(largest, stored)
        assert held - solver.work_now == pytest.approx(start, rel=1e-3)
        assert stored == pytest.approx(-solver.work_now, abs=2e-3 * start)
    assert largest > 0.5 * start


def test_static_displacement_under_a_traction():
    """The face moves by traction over stiffness, and the column stretches by its own strain."""
    pull = 1e-4
    load = Traction(1, 1, (0.0, pull), lambda _: 1.0)
    damping = (DampingRegion(rate=2.0 * (STIFFNESS / HEIGHT) ** 0.5),)
    solver, foundation = column(Method("musl", damping=damping, configuration="reference"), load)
    while solver.time < 600.0:
        solver.step()
    p = solver.points
    u = (p.x - p.reference)[:, 1]
    expected = pull / STIFFNESS + pull / MODULUS[1] * p.reference[:, 1]
    assert u == pytest.approx(expected, rel=1e-6)
    assert foundation.energy() == pytest.approx(0.5 * 4.0 * pull**2 / STIFFNESS, rel=1e-6)

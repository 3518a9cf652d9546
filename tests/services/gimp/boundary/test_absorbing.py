"""Absorbing faces against the exact reflection of viscous dashpots.

Density 1, longitudinal wave speed 1, shear wave speed ``sqrt(1/3)``.
"""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.boundary.absorbing import Absorbing, impedance
from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.laws import LinearElastic, NeoHookean
from gimpmd_gimp.points.distribution import fill
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver
from tests.services.gimp.ranks import on_ranks

LAW = LinearElastic(1.0, 1.0 / 3.0, 1.0 / 3.0)
SPEEDS = (1.0, np.sqrt(1.0 / 3.0))


def body(hierarchy, comm=None, integrator="usavg", law=LAW, dt=0.4, **conditions):
    mesh = Mesh(hierarchy, comm)
    method = Method(integrator=integrator, xpic_every=0)
    points = fill(mesh, 2, law.density)
    return Solver(mesh, points, law, method, dt / 2**hierarchy.top, **conditions)


def test_impedances_are_those_of_plane_waves():
    law = LinearElastic(2.0, 3.0, 0.5)
    P, S = np.sqrt(2.0 * 4.0), np.sqrt(2.0 * 0.5)
    assert impedance(law, 1, 3) == pytest.approx((S, P, S), rel=1e-9)
    assert impedance(law, 0, 1) == pytest.approx((P,), rel=1e-9)
    assert impedance(NeoHookean(2.0, 3.0, 0.5), 0, 2) == pytest.approx((P, S), rel=1e-9)


FIN = ((((64, 128), (0, 8)),),)


def left_over(component, width, integrator, finer=()):
    """Energy left of a pulse sent to an absorbing face, and the work of the dashpots."""
    h = Hierarchy((0.0, 0.0), 1.0, (64, 4), (False, True), finer)
    solver = body(h, integrator=integrator, conditions=[Absorbing(0, 0), Absorbing(0, 1)])
    p, c = solver.points, SPEEDS[component]
    shape = 1e-4 * np.exp(-0.5 * ((p.reference[:, 0] - 36.0) / width) ** 2)
    p.v[:, component] = shape
    p.F[:, component, 0] -= shape / c
    before = solver.energies()[:2].sum()
    while solver.time < 50.0 / c:
        solver.step()
    after = solver.energies()[:2].sum()
    return after / before, solver.work.external / before


@pytest.mark.parametrize("integrator", ["usavg", "musl", "usl", "usf"])
@pytest.mark.parametrize("component", [0, 1])
@pytest.mark.parametrize("finer", [(), FIN], ids=["one level", "two levels"])
def test_no_reflection_at_normal_incidence(component, integrator, finer):
    """Theory: nothing comes back. Measured: 1.1e-3 of the energy for a pulse of width 4 h."""
    left, work = left_over(component, 4.0, integrator, finer)
    assert left < 1.5e-3
    if integrator in ("usavg", "musl"):
        assert work == pytest.approx(left - 1.0, abs=0.01)


@pytest.mark.parametrize("component", [0, 1])
def test_what_is_left_falls_with_the_square_of_the_cell(component):
    coarse, _ = left_over(component, 4.0, "usavg")
    fine, _ = left_over(component, 8.0, "usavg")
    assert fine < 0.3 * coarse


def exact_reflection(angle, wave):
    """Amplitudes of the reflected P and S waves (displacements) at a face of dashpots.

    A wave ``a e^{i(k.x - w t)}`` at the face y = 0 of y < 0 has the traction ``(t_x, t_y)`` and
    velocity ``-i w a``; those of all three waves obey ``t_x = -rho c_S v_x`` and
    ``t_y = -rho c_P v_y``.
    """
    cP, cS = SPEEDS
    slowness = np.sin(angle) / SPEEDS["PS".index(wave)]

    def rest(kind, sign):
        c = SPEEDS["PS".index(kind)]
        n = np.array([slowness * c, sign * np.emath.sqrt(1.0 - (slowness * c) ** 2)])
        a = n if kind == "P" else np.array([-n[1], n[0]])
        gradient = np.outer(a, n) / c  # per i w
        strain = 0.5 * (gradient + gradient.T)
        stress = LAW.lame * np.trace(strain) * np.eye(2) + 2.0 * LAW.shear * strain
        return stress[:, 1] - np.array([cS, cP]) * a  # what dashpots do not balance

    matrix = np.column_stack([rest("P", -1.0), rest("S", -1.0)])
    return np.linalg.solve(matrix, -rest(wave, 1.0))


SIGMA, START, TALL = 16.0, 116.0, 176


def spectrum(angle, wave, width):
    """Wave vectors, of one component along x, and weights of a packet of length ``SIGMA``."""
    kx = 2.0 * np.pi / width
    ky = kx / np.tan(angle) + np.linspace(-3.5, 3.5, 41) / SIGMA
    return np.column_stack([np.full(41, kx), ky]), np.exp(-0.5 * np.linspace(-3.5, 3.5, 41) ** 2)


def polarization(n, wave):
    return n if wave == "P" else np.stack([-n[..., 1], n[..., 0]], axis=-1)


def expected(angle, wave, width):
    """Squares of the reflected divergence and curl, over the square of the incident wave's own.

    The frequency stays; a packet's length along y goes by the speed at which it travels along y.
    """
    k, weight = spectrum(angle, wave, width)
    c = SPEEDS["PS".index(wave)]
    before, after = 0.0, np.zeros(2)
    for one, share in zip(k, weight, strict=True):
        theta, size = np.arctan2(one[0], one[1]), np.linalg.norm(one)
        before += (share * size) ** 2
        for i, amplitude in enumerate(exact_reflection(theta, wave)):
            sine = np.sin(theta) * SPEEDS[i] / c
            if sine < 1.0:  # else it clings to the face
                stretch = SPEEDS[i] * np.sqrt(1.0 - sine**2) / (c * np.cos(theta))
                after[i] += stretch * abs(amplitude * share * size * c / SPEEDS[i]) ** 2
    return after / before


def measured(angle, wave, width):
    """The same from a packet of plane waves on a grid that is periodic along x."""
    c = SPEEDS["PS".index(wave)]
    h = Hierarchy((0.0, 0.0), 1.0, (width, TALL), (True, False))
    solver = body(h, conditions=[Absorbing(1, 1)])
    p = solver.points
    for k, weight in zip(*spectrum(angle, wave, width), strict=True):
        size = np.linalg.norm(k)
        a = polarization(k / size, wave)
        slope = 1e-5 * weight * np.cos((p.reference - (0.0, START)) @ k)
        p.F += slope[:, None, None] * np.outer(a, k)
        p.v -= c * size * slope[:, None] * a

    def parts():
        solver.refresh()
        solver.stages.project()  # what the grid sees: no strain that points keep for themselves
        L = solver.body.velocity_gradient(np.arange(solver.points.count), solver.V)
        div, curl = L[:, 0, 0] + L[:, 1, 1], L[:, 1, 0] - L[:, 0, 1]
        return np.array([div @ div, curl @ curl])

    before = parts()["PS".index(wave)]
    while solver.time < (2.0 * TALL - 2.0 * START - 4.0) / (c * np.cos(angle)):
        solver.step()
    return parts() / before


@pytest.mark.parametrize(
    ("angle", "wave", "width"),
    [
        (45.0, "P", 32),
        pytest.param(30.0, "P", 48, marks=pytest.mark.long),
        pytest.param(30.0, "S", 24, marks=pytest.mark.long),
    ],
)
def test_waves_at_an_angle_are_reflected_as_theory_has_it(angle, wave, width):
    """Wave lengths of 23, 24 and 12 cells; measured deviations are 0.017, 0.010 and 0.022."""
    exact = np.sqrt(expected(np.radians(angle), wave, width))
    assert np.sqrt(measured(np.radians(angle), wave, width)) == pytest.approx(exact, abs=0.025)


def across_ranks():
    from mpi4py import MPI

    world = MPI.COMM_WORLD
    work = []
    for comm in (world, None):
        h = Hierarchy((0.0, 0.0), 1.0, (16, 16), (False, False), ((((10, 32), (8, 24)),),))
        solver = body(h, comm, conditions=[Absorbing(0, 1), Absorbing(1, 0)])
        p = solver.points
        p.v[:, 0] = 1e-3 * np.exp(-0.1 * ((p.reference - 8.0) ** 2).sum(axis=1))
        for _ in range(40):
            solver.step()
        work.append(solver.work.external)
    total = world.allreduce(work[0])
    assert total < 0.0
    assert total == pytest.approx(work[1], rel=1e-10)


def test_ranks_agree():
    on_ranks(2, __file__, "across_ranks")

"""Absorbing faces against the exact reflection of viscous dashpots; prescribed displacements.

Density 1, longitudinal wave speed 1, shear wave speed ``sqrt(1/3)``.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from gimpmd_gimp.absorbing import Absorbing, impedance
from gimpmd_gimp.conditions import Displaced
from gimpmd_gimp.hierarchy import Hierarchy
from gimpmd_gimp.laws import LinearElastic, NeoHookean
from gimpmd_gimp.mesh import Mesh
from gimpmd_gimp.placing import fill
from gimpmd_gimp.solver import Scheme, Solver

LAW = LinearElastic(1.0, 1.0 / 3.0, 1.0 / 3.0)
SPEEDS = (1.0, np.sqrt(1.0 / 3.0))


def on_ranks(*arguments):
    spec = importlib.util.spec_from_file_location("ranks", Path(__file__).parent / "ranks.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.on_ranks(*arguments)


def body(hierarchy, comm=None, integrator="usavg", law=LAW, dt=0.4, **conditions):
    mesh = Mesh(hierarchy, comm)
    scheme = Scheme(integrator=integrator, xpic_every=0)
    points = fill(mesh, 2, law.density)
    return Solver(mesh, points, law, scheme, dt / 2**hierarchy.top, **conditions)


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
    solver = body(h, integrator=integrator, absorbing=[Absorbing(0, 0), Absorbing(0, 1)])
    p, c = solver.points, SPEEDS[component]
    shape = 1e-4 * np.exp(-0.5 * ((p.reference[:, 0] - 36.0) / width) ** 2)
    p.v[:, component] = shape
    p.F[:, component, 0] -= shape / c
    before = solver.energies()[:2].sum()
    while solver.time < 50.0 / c:
        solver.step()
    after = solver.energies()[:2].sum()
    return after / before, solver.external_work / before


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
    velocity ``-i w a``; those of all three waves obey ``t_x = -rho c_S v_x``, ``t_y = -rho c_P v_y``.
    """
    cP, cS = SPEEDS
    slowness = np.sin(angle) / SPEEDS["PS".index(wave)]

    def rest(kind, sign):
        c = SPEEDS["PS".index(kind)]
        n = np.array([slowness * c, sign * np.sqrt(1.0 - (slowness * c) ** 2)])
        a = n if kind == "P" else np.array([-n[1], n[0]])
        gradient = np.outer(a, n) / c  # per i w
        strain = 0.5 * (gradient + gradient.T)
        stress = LAW.lame * np.trace(strain) * np.eye(2) + 2.0 * LAW.shear * strain
        return stress[:, 1] - np.array([cS, cP]) * a  # what dashpots do not balance

    matrix = np.column_stack([rest("P", -1.0), rest("S", -1.0)])
    return np.linalg.solve(matrix, -rest(wave, 1.0))


def measured_reflection(angle, wave, width):
    """The same for a packet on a grid, periodic along x, from the divergence and curl of u."""
    kx = 2.0 * np.pi / width
    k = kx / np.sin(angle)
    n = np.array([np.sin(angle), np.cos(angle)])
    c = SPEEDS["PS".index(wave)]
    h = Hierarchy((0.0, 0.0), 1.0, (width, 176), (True, False))
    solver = body(h, absorbing=[Absorbing(1, 1)])
    p = solver.points
    a = n if wave == "P" else np.array([-n[1], n[0]])
    phase = k * p.reference @ n
    envelope = 1e-4 * np.exp(-0.5 * ((p.reference[:, 1] - 116.0) / 16.0) ** 2)
    slope = np.column_stack([0.0 * phase, -(p.reference[:, 1] - 116.0) / 16.0**2 * envelope])
    wavy = k * n * (envelope * np.cos(phase))[:, None]
    gradient = wavy + slope * np.sin(phase)[:, None]
    p.F += a[None, :, None] * gradient[:, None, :]
    p.v -= c * a * (gradient @ n)[:, None]

    def parts():
        F = solver.points.F - np.eye(2)
        return np.array([np.sum((F[:, 0, 0] + F[:, 1, 1]) ** 2), np.sum((F[:, 1, 0] - F[:, 0, 1]) ** 2)])

    before = parts()["PS".index(wave)]
    while solver.time < 1.95 * 60.0 / (c * np.cos(angle)):
        solver.step()
    out = []
    for kind, amount in zip("PS", parts(), strict=True):
        other = SPEEDS["PS".index(kind)]
        cosine = np.sqrt(1.0 - (np.sin(angle) * other / c) ** 2)
        stretch = other * cosine / (c * np.cos(angle))  # of the packet along y
        out.append(np.sqrt(amount / before / stretch) * other / c)
    return np.array(out)


@pytest.mark.parametrize(("angle", "wave", "width"), [(30.0, "P", 24), (45.0, "P", 16), (30.0, "S", 24)])
def test_waves_at_an_angle_are_reflected_as_theory_has_it(angle, wave, width):
    exact = np.abs(exact_reflection(np.radians(angle), wave))
    found = measured_reflection(np.radians(angle), wave, width)
    assert found == pytest.approx(exact, abs=0.03)

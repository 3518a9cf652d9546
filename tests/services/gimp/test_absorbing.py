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


@pytest.mark.parametrize("integrator", ["usavg", "musl", "usl", "usf"])
@pytest.mark.parametrize("component", [0, 1])
@pytest.mark.parametrize("finer", [(), FIN], ids=["one level", "two levels"])
def test_no_reflection_at_normal_incidence(component, integrator, finer):
    """A pulse of width 4 h goes out; what is left are ripples of dispersion, of percents."""
    h = Hierarchy((0.0, 0.0), 1.0, (64, 4), (False, True), finer)
    solver = body(h, integrator=integrator, absorbing=[Absorbing(0, 1)])
    p, c = solver.points, SPEEDS[component]
    shape = 1e-4 * np.exp(-0.5 * ((p.reference[:, 0] - 36.0) / 4.0) ** 2)
    p.v[:, component] = shape
    p.F[:, component, 0] -= shape / c
    before = solver.energies()[:2].sum()
    while solver.time < 50.0 / c:
        solver.step()
    after = solver.energies()[:2].sum()
    assert after < 1e-3 * before
    if integrator in ("usavg", "musl"):
        assert solver.external_work == pytest.approx(after - before, rel=5e-3)


def reflected(angle, wave, m=1, cells=32):
    """Energy left of a plane wave sent at an angle against an absorbing top, over what it brought.

    The wave is periodic along x; its packet along y is long, so that one angle rules.
    """
    c = SPEEDS["PS".index(wave)]
    width = 8.0
    kx = 2.0 * np.pi * m / width
    k = kx / np.sin(angle)
    ky = k * np.cos(angle)
    height = 160.0
    h = Hierarchy((0.0, 0.0), 1.0, (int(width), int(height)), (True, False))
    solver = body(h, absorbing=[Absorbing(1, 1)], dt=0.4)
    p = solver.points
    n = np.array([np.sin(angle), np.cos(angle)])
    polarization = n if wave == "P" else np.array([-n[1], n[0]])
    X = p.reference
    return solver, k, n, polarization, X, c, ky

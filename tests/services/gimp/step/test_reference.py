"""The reference configuration: points stay on the grid where they stand at rest."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.boundary.absorbing import Absorbing
from gimpmd_gimp.boundary.prescribed_displacement import PrescribedDisplacement
from gimpmd_gimp.boundary.traction import Traction
from gimpmd_gimp.fracture.cracks import make_cracks
from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.laws import LinearElastic, NeoHookean
from gimpmd_gimp.points.distribution import fill
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver

LAW = LinearElastic(1.0, 1.0 / 3.0, 1.0 / 3.0)
LARGE = NeoHookean(1.0, 1.0 / 3.0, 1.0 / 3.0)
NESTED = ((((12, 36), (12, 36)),), (((40, 56), (40, 56)),))
"""Boxes of two finer levels in 24 x 24 cells."""


def body(
    law,
    finer=(),
    integrator="musl",
    configuration="reference",
    periodic=(False, False),
    **conditions,
):
    """A square of 24 cells."""
    mesh = Mesh(Hierarchy((0.0, 0.0), 1.0, (24, 24), periodic, finer))
    points = fill(mesh, 2, law.density)
    initial = conditions.pop("initial", None)
    if initial is not None:
        initial(points)
    method = Method(integrator, xpic_every=0, configuration=configuration)
    dt = 0.4 / 2 ** len(finer)
    return Solver(mesh, points, law, method, dt, **conditions)


def advance(solver, steps):
    for _ in range(steps * 2**solver.top):
        solver.step()


@pytest.mark.parametrize("integrator", ["musl", "usavg", "usl", "usf"])
def test_a_body_in_finite_motion_is_the_same_wherever_and_however_it_lies(integrator):
    """A shift by many cells at the start and a finite turn change nothing: F goes with the turn."""
    angle = 1.0
    R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

    def at_rest(p):
        p.v[:, 0] = 0.05 * np.sin(2 * np.pi * p.reference[:, 1] / 24.0)

    def moved(p):
        at_rest(p)
        p.x[:] = p.reference @ R.T + [100.0, -40.0]
        p.F[:] = R
        p.v[:] = p.v @ R.T

    plain, turned = (body(LARGE, NESTED, integrator, initial=i) for i in (at_rest, moved))
    stencils = turned.body.stencils.base.copy()
    for solver in (plain, turned):
        advance(solver, 40)
    assert np.array_equal(turned.body.stencils.base, stencils)
    a, b = plain.points, turned.points
    assert np.array_equal(a.id, b.id)
    assert np.abs(a.x - a.reference).max() > 0.2
    assert np.abs(b.x - a.x @ R.T - [100.0, -40.0]).max() < 1e-11
    assert np.abs(b.F - R @ a.F).max() < 1e-12


def test_small_motion_is_that_of_the_current_configuration():
    def shake(p):
        p.v[:] = 1e-9 * np.random.default_rng(1).normal(size=(p.id.max() + 1, 2))[p.id]

    solvers = [body(LAW, NESTED, configuration=c, initial=shake) for c in ("current", "reference")]
    for solver in solvers:
        advance(solver, 20)
    a, b = (solver.points for solver in solvers)
    order = np.argsort(a.id), np.argsort(b.id)
    assert np.array_equal(a.id[order[0]], b.id[order[1]])
    # points have moved by 3e-8 cells, weights change by as much
    assert np.abs(a.v[order[0]] - b.v[order[1]]).max() < 1e-6 * np.abs(a.v).max()


@pytest.mark.parametrize("law", [LAW, LARGE], ids=["linear", "neo-Hookean"])
def test_uniform_strain_exerts_no_force(law):
    """With finite strain and rotation."""
    H = np.array([[0.02, 0.15], [-0.1, -0.03]]) * (1e-4 if law is LAW else 1.0)

    def strained(p):
        p.F[:] += H
        p.x[:] += p.reference @ H.T

    solver = body(law, initial=strained, periodic=(True, True))
    advance(solver, 100)
    assert np.abs(solver.points.v).max() < 1e-14
    assert np.abs(solver.points.F - np.eye(2) - H).max() < 1e-14


def test_momentum_and_angular_momentum_of_a_free_body_at_large_strain():
    """The total Lagrangian weak form keeps both: the second by the symmetry of ``P F^T``."""

    def spun(p):
        X = p.reference - 12.0
        p.v[:] = 0.02 * np.stack([-X[:, 1], X[:, 0]], axis=1) + 0.01 * X + [0.3, -0.2]

    solver = body(LARGE, initial=spun)
    p = solver.points

    def momenta():
        # in the sum over points x stands where v does, half a step before F
        x = p.x - 0.5 * solver.dt * p.v
        return np.array([*(p.mass @ p.v), p.mass @ (x[:, 0] * p.v[:, 1] - x[:, 1] * p.v[:, 0])])

    before = momenta()
    advance(solver, 200)
    after = momenta()
    assert np.abs(p.x - p.reference).max() > 10.0  # ten cells away
    assert after[:2] == pytest.approx(before[:2], rel=1e-12)
    assert after[2] == pytest.approx(before[2], rel=2e-3)


def test_tractions_are_dead_loads_on_the_body_at_rest():
    """A body held on one side and pulled on the other comes to rest at the exact finite stretch."""
    pull = 0.05

    def damped(p):
        p.v[:] = 0.0

    solver = body(
        LARGE,
        initial=damped,
        conditions=[
            Traction(0, 1, (pull, 0.0), lambda t: min(1.0, t / 600.0)),
            *(PrescribedDisplacement(axis, 0, axis, lambda t: 0.0) for axis in (0, 1)),
            PrescribedDisplacement(1, 1, 1, lambda t: 0.0),
        ],
    )
    advance(solver, 1500)
    # uniaxial strain: P = (lame ln F + mu (F^2 - 1)) / F
    low, high = 1.0, 1.2
    for _ in range(60):
        F = 0.5 * (low + high)
        P = (LARGE.lame * np.log(F) + LARGE.shear * (F**2 - 1.0)) / F
        low, high = (F, high) if pull > P else (low, F)
    assert solver.points.F[:, 0, 0].mean() == pytest.approx(F, rel=1e-3)
    kinetic, strain = solver.energies()[:2]
    assert kinetic + strain == pytest.approx(solver.work_now, rel=1e-3)


def test_absorbing_face_takes_a_wave_out_of_a_body_that_has_moved_away():
    def pulse(p):
        f = 1e-3 * np.exp(-0.5 * ((p.reference[:, 0] - 12.0) / 3.0) ** 2)
        p.v[:, 0] = f
        p.F[:, 0, 0] -= f
        p.x[:] += 50.0

    solver = body(LAW, initial=pulse, periodic=(False, True), conditions=[Absorbing(0, 1)])
    start = solver.energies()[:2].sum()
    advance(solver, 70)
    assert solver.energies()[:2].sum() < 5e-3 * start


def test_an_opened_crack_is_seen_however_far_its_faces_are():
    """Two halves that part for good go on with their own velocities, with or without contact."""
    for friction in (None, 0.3):
        h = Hierarchy((0.0, 0.0), 1.0, (24, 24), (False, False))
        cracks = make_cracks([((0.0, 12.0), (24.0, 12.0))], h, friction=friction)
        mesh = Mesh(h, cracks=cracks)
        points = fill(mesh, 2, 1.0)
        points.v[:, 1] = 0.1 * np.sign(points.reference[:, 1] - 12.0)
        method = Method("musl", xpic_every=0, configuration="reference")
        solver = Solver(mesh, points, LAW, method, 0.4, cracks=cracks)
        advance(solver, 200)
        p = solver.points
        moved = 0.1 * solver.time * np.sign(p.reference[:, 1] - 12.0)
        assert np.abs(p.x[:, 1] - p.reference[:, 1] - moved).max() < 1e-9
        assert np.abs(p.F - np.eye(2)).max() < 1e-12


def shear_wave(p):
    p.v[:, 0] = 0.05 * np.sin(2 * np.pi * p.reference[:, 1] / 24.0)


@pytest.mark.parametrize(("law", "finer"), [(LAW, ()), (LARGE, ()), (LARGE, NESTED)])
def test_a_step_in_parts_is_the_same_step(law, finer):
    """Started, ended and prepared for those who wait for its velocities, or taken at once."""
    whole, parts = (body(law, finer, initial=shear_wave) for _ in range(2))
    for _ in range(6 * 2**whole.top):
        whole.step()
        parts.start_step()
        assert np.array_equal(parts.V, whole.V)
        parts.end_step()
        parts.prepare()
    for name in ("x", "v", "F"):
        assert np.array_equal(getattr(parts.points, name), getattr(whole.points, name))


def test_a_step_ends_at_the_latest_when_the_next_one_starts():
    whole, parts = (body(LARGE, initial=shear_wave) for _ in range(2))
    for _ in range(6):
        whole.step()
        parts.start_step()
    parts.end_step()
    assert np.array_equal(parts.points.F, whole.points.F)


@pytest.mark.parametrize("finer", [(), NESTED])
def test_exact_energies_may_be_asked_for_between_preparation_and_step(finer):
    plain, prepared = (body(LARGE, finer, initial=shear_wave) for _ in range(2))
    for _ in range(4):
        advance(plain, 1)
        advance(prepared, 1)
        prepared.prepare()
        assert np.array_equal(prepared.energies(), plain.energies())
    assert np.array_equal(prepared.points.v, plain.points.v)

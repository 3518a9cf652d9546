"""The dispersion correction, forces from outside, and exact energies, in the reference frame."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from gimpmd_gimp.boundary.absorbing import Absorbing
from gimpmd_gimp.boundary.prescribed_velocity import PrescribedVelocity
from gimpmd_gimp.fracture.cracks import make_cracks
from gimpmd_gimp.grid import subcycling
from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.laws import LinearElastic
from gimpmd_gimp.points.distribution import fill
from gimpmd_gimp.points.groups import ALL
from gimpmd_gimp.points.material_points import join
from gimpmd_gimp.step.dispersion import correction
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver
from gimpmd_gimp.sweeps import threads
from gimpmd_schemas.case.checks.stability import MAX_CFL
from gimpmd_schemas.errors import BackendError
from tests.services.gimp.ranks import on_ranks

LAW = LinearElastic(1.0, 1.0 / 3.0, 1.0 / 3.0)
BETA = correction(0.25)
NESTED = ((((20, 60), (20, 60)),), (((64, 96), (64, 96)),))
"""Boxes of two finer levels in 40 x 40 cells, eight coarser cells between rims."""

CLOSE = ((((8, 40), (8, 40)),), (((32, 64), (32, 48)),))
"""Boxes in 24 x 24 cells, with as little between rims as a case may have."""


def noise(points, size=1e-6):
    """Random velocities that depend on a point's place alone."""
    for axis in range(points.dim):
        phase = points.reference @ np.array([12.9898, 78.233, 37.719])[: points.dim] + 3.1 * axis
        points.v[:, axis] += size * (np.modf(43758.5453 * np.sin(phase))[0] + 0.1)


def body(
    cells=(12, 10),
    finer=(),
    beta=BETA,
    cfl=0.4,
    periodic=None,
    initial=noise,
    comm=None,
    per_cell=2,
    threads=1,
    **conditions,
):
    d = len(cells)
    h = Hierarchy((0.0,) * d, 1.0, cells, periodic or (True,) * d, finer)
    mesh = Mesh(h, comm, cracks=conditions.get("cracks"))
    points = fill(mesh, per_cell, 1.0)
    initial(points)
    method = Method("musl", xpic_every=0, configuration="reference", dispersion=beta)
    dt = cfl / 2 ** len(finer)
    return Solver(mesh, points, LAW, method, dt, threads=threads, **conditions)


def advance(solver, steps):
    for _ in range(steps * 2**solver.top):
        solver.step()


def exact_energies(solver, steps):
    """Energy at the beginning of some steps, and the one that leapfrog keeps in a linear system.

    The latter has ``v_before . v_after`` in the place of the square of their mean.
    """
    energies, kept = [], []
    for _ in range(steps):
        strain = solver.strain_energy()[0]
        start = solver.steps == 0
        solver.step()
        p = solver.points
        energies.append(solver.stages.kick_sums[0] + strain)
        kept.append(energies[-1] - (not start) * p.mass @ (p.dv**2).sum(axis=1) / 8.0)
    return np.array(energies), np.array(kept)


def test_strengths_are_those_of_the_scheme():
    """Figures of the force scheme's derivation for 2 and 4 points per cell and direction."""
    assert correction(0.25) == pytest.approx(0.722, abs=5e-4)
    assert correction(0.125) == pytest.approx(0.742, abs=5e-4)


@pytest.mark.parametrize(
    ("cells", "periodic", "finer"),
    [
        ((9,), (False,), ()),
        ((8, 6), (True, False), ()),
        ((5, 4, 6), (False, True, False), ()),
        ((24, 24), (False, False), CLOSE),
    ],
)
def test_correction_is_that_of_the_projection_to_points_and_back(cells, periodic, finer):
    """By gather and scatter, ``V + beta (V - M^-1 S^T m S V)``; and ``M Q`` is symmetric."""
    solver = body(cells, finer, periodic=periodic)
    mesh, p = solver.mesh, solver.points
    nodes = np.flatnonzero(mesh.basis & (solver.nodes.mass_floor < solver.M))
    rng = np.random.default_rng(1)
    corrected, M = [], solver.M[nodes, None]
    fields = rng.normal(size=(2, nodes.size, p.dim))
    for field in fields:
        V = np.zeros_like(solver.V)
        V[nodes] = field
        prolonged = V.copy()
        mesh.constraints.prolong(prolonged)
        v, P = np.zeros_like(p.v), np.zeros_like(V)
        solver.body.gather(ALL, prolonged, 1.0, v)
        solver.body.scatter(ALL, v, P)
        mesh.constraints.restrict(P)
        expected = field + BETA * (field - P[nodes] / M)
        dispersion = solver.stages.dispersion
        for correct in (dispersion.correct_change, dispersion.correct_velocity):
            found = V.copy()
            correct(0, solver.nodes, found)
            assert np.abs(found[nodes] - expected).max() < 1e-12
        corrected.append(expected)
    one, other = np.sum(M * fields[0] * corrected[1]), np.sum(M * fields[1] * corrected[0])
    assert one == pytest.approx(other, rel=1e-11)


@pytest.mark.parametrize("cfl", [0.4, 1.0])
@pytest.mark.parametrize("kind", ["periodic", "free", "held", "cracked"])
def test_energy_is_exact_over_100_periods(kind, cfl):
    """White noise; a period of a wave of ten cells is ten time units."""
    conditions = {"periodic": {"periodic": (True, True)}}.get(kind, {"periodic": (False, False)})
    if kind == "held":
        conditions["conditions"] = [
            PrescribedVelocity(0, 0, 0, lambda t: 0.0),
            PrescribedVelocity(1, 1, 0, lambda t: 0.0),
        ]
    if kind == "cracked":
        h = Hierarchy((0.0, 0.0), 1.0, (12, 10), (False, False))
        conditions["cracks"] = make_cracks([((0.0, 5.2), (6.0, 5.2))], h)
    # loud: rounding of F, which is near one, would hide in a small motion
    solver = body(cfl=cfl, initial=lambda points: noise(points, 1e-2), **conditions)
    energies, kept = exact_energies(solver, int(1000 / cfl))
    assert np.abs(kept / kept[0] - 1.0).max() < 1e-11
    # the energy itself ripples with (omega dt / 2)^2 but has no trend
    ends = energies[1:200].mean(), energies[-200:].mean()
    assert ends[0] == pytest.approx(ends[1], rel=2e-3)
    assert energies.min() > (1.0 - 1e-11) * energies[0]


@pytest.mark.parametrize("finer", [(), NESTED], ids=["one level", "three levels"])
def test_energies_in_the_kick_are_those_of_a_part_of_the_next_kick(finer):
    solver = body((40, 40), finer)
    for _ in range(4):
        before = solver.energies(exact=True)
        strain, mass = solver.strain_energy()
        solver.step()
        assert solver.stages.kick_sums[0] == pytest.approx(before[0], rel=1e-12)
        assert solver.stages.kick_sums[1:] == pytest.approx(before[3:], rel=1e-12)
        assert (strain, mass) == pytest.approx(tuple(before[1:3]), rel=1e-12)
        sums = solver.stages.kick_sums.copy()
        for _ in range(2**solver.top - 1):
            solver.step()  # finer levels alone leave the sums of the common time
        assert np.array_equal(solver.stages.kick_sums, sums)


def test_bodies_move_without_strain_through_all_levels():
    def push(points):
        points.v[:] = [0.3, -0.2]

    solver = body((24, 24), CLOSE, periodic=(False, False), initial=push)
    advance(solver, 50)
    p = solver.points
    assert np.abs(p.F - np.eye(2)).max() < 1e-13
    assert np.abs(p.x - p.reference - solver.time * np.array([0.3, -0.2])).max() < 1e-12


def test_uniform_strain_exerts_no_force():
    H = np.array([[0.02, 0.15], [-0.1, -0.03]])

    def strain(points):
        points.F[:] += H

    solver = body(initial=strain)
    advance(solver, 100)
    assert np.abs(solver.points.v).max() < 1e-14
    assert np.abs(solver.points.F - np.eye(2) - H).max() < 1e-14


@pytest.mark.parametrize(("finer", "cells"), [(NESTED, (40, 40)), (CLOSE, (24, 24))])
def test_momentum_is_exact_and_energy_bounded_on_three_levels(finer, cells):
    solver = body(cells, finer, cfl=1.0)
    before = solver.points.mass @ solver.points.v
    energies = []
    for _ in range(300):
        strain = solver.strain_energy()[0]
        advance(solver, 1)
        energies.append(solver.stages.kick_sums[0] + strain)
    size = solver.points.mass @ np.abs(solver.points.v)
    assert np.abs(solver.points.mass @ solver.points.v - before).max() < 1e-12 * size.max()
    assert max(energies) < 1.3 * energies[0]  # the ripple of (omega dt / 2)^2
    assert np.mean(energies[-50:]) == pytest.approx(np.mean(energies[1:51]), rel=5e-3)


def test_sub_steps_reach_as_far_as_they_must(monkeypatch):
    """All that a finer level's sub-step changes lies within its reach: a longer one is the same."""

    def run(reach, kicked):
        monkeypatch.setattr(subcycling, "NODES_COUPLED", reach)
        monkeypatch.setattr(subcycling, "NODES_COMPLETE", reach + 0.5)
        monkeypatch.setattr(subcycling, "NODES_KICKED", kicked)
        solver = body((40, 40), NESTED)
        advance(solver, 10)
        return solver.points.v

    enough = run(4.0, 2.5)
    assert np.abs(run(6.0, 4.5) - enough).max() < 2e-15
    assert np.abs(run(4.0, 1.5) - enough).max() > 1e-9
    assert np.abs(run(3.0, 2.5) - enough).max() > 1e-11


def critical(dim, per_cell, poisson, beta):
    """Critical ``c dt / h`` by the symbol of the discrete system: waves of all directions.

    Points lie within cells, so weights are those of linear interpolation at their centres.
    """
    lame = poisson / (1.0 - poisson)
    mu = 0.5 * (1.0 - lame)
    x = (np.arange(per_cell) + 0.5) / per_cell
    fastest = 0.0
    for k in product(np.linspace(0.0, np.pi, 9), repeat=dim):
        s = [(1.0 - x) + x * np.exp(1j * q) for q in k]
        g = [np.exp(1j * q) - 1.0 for q in k]
        K, Pi = np.zeros((dim, dim), dtype=complex), 0.0
        for index in product(range(per_cell), repeat=dim):
            w = [s[a][i] for a, i in enumerate(index)]
            Pi += abs(np.prod(w)) ** 2 / per_cell**dim
            G = np.array([g[a] * np.prod(w[:a] + w[a + 1 :]) for a in range(dim)])
            H = np.outer(G.conj(), G) / per_cell**dim
            K += lame * H + mu * (H.T + np.trace(H) * np.eye(dim))
        squared = Pi * (1.0 + beta * (1.0 - Pi)) ** 2 * np.linalg.eigvalsh(K)[-1]
        fastest = max(fastest, squared)
    return 2.0 / np.sqrt(fastest)


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_accepted_steps_keep_a_margin(dim):
    assert critical(1, 2, 0.25, 0.0) == pytest.approx(1.73, abs=5e-3)
    assert critical(dim, 2, 0.25, BETA) == pytest.approx(1.234, abs=5e-3)
    for per_cell in (1, 2, 3, 4) if dim < 3 else (1, 2):
        for poisson in (-0.5, 0.0, 0.25, 0.45):
            number = critical(dim, per_cell, poisson, correction(0.5 / per_cell))
            assert number > 1.15 * MAX_CFL


@pytest.mark.parametrize(("cfl", "stable"), [(1.15, True), (1.3, False)])
def test_critical_step_of_a_free_body(cfl, stable):
    solver = body(cfl=cfl, periodic=(False, False))
    start = solver.energies()[:2].sum()
    advance(solver, 400)
    grown = solver.points.mass @ (solver.points.v**2).sum(axis=1) / start
    assert (grown < 10.0) == stable


def test_a_run_that_blows_up_ends_with_a_message():
    with pytest.raises(BackendError, match="kinetic energy is not finite"):
        advance(body(cfl=3.0, periodic=(False, False)), 2000)


@pytest.mark.parametrize("size", [2, 3])
def test_any_number_of_threads_gives_the_same_bits(monkeypatch, size):
    monkeypatch.setattr(threads, "SMALL", 0)
    one, several = (body((24, 24), CLOSE, threads=n) for n in (1, size))
    for solver in (one, several):
        advance(solver, 5)
    for name in ("x", "v", "F"):
        assert np.array_equal(getattr(one.points, name), getattr(several.points, name))
    assert np.array_equal(one.V, several.V)
    assert np.array_equal(one.stages.kick_sums, several.stages.kick_sums)


def compare_ranks():
    """On all ranks: the same body alone, and shared."""
    from mpi4py import MPI

    world = MPI.COMM_WORLD
    for finer, cells in ((CLOSE, (24, 24)), ((), (12, 10))):
        for periodic in ((True, False), (False, False)):
            conditions = {
                "periodic": periodic,
                "conditions": [Absorbing(1, 1), PrescribedVelocity(1, 0, 1, lambda t: 1e-6 * t)],
            }
            alone = body(cells, finer, **conditions)
            shared = body(cells, finer, comm=world, **conditions)
            for solver in (alone, shared):
                advance(solver, 20)
            p, q = alone.points, join(world.allgather(shared.points))
            a, b = np.argsort(p.id), np.argsort(q.id)
            assert np.array_equal(p.id[a], q.id[b])
            for name in ("v", "F"):
                one, other = getattr(p, name)[a], getattr(q, name)[b]
                assert np.abs(one - other).max() < 1e-13
            sums = world.allreduce(shared.stages.kick_sums)
            assert np.abs(sums / alone.stages.kick_sums - 1.0).max() < 1e-10
            assert np.abs(p.v).max() > 1e-8  # which 1e-13 is far below


@pytest.mark.parametrize("ranks", [2, 4])
def test_ranks_agree(ranks):
    on_ranks(ranks, __file__, "compare_ranks")


@pytest.mark.parametrize("beta", [0.0, BETA])
def test_a_wall_in_motion_does_the_work_that_the_body_gains(beta):
    """A body pushed at a constant speed: energies and work at the times of kicks."""
    speed = 1e-3
    solver = body(
        (24, 4),
        beta=beta,
        periodic=(False, True),
        initial=lambda points: None,
        conditions=[PrescribedVelocity(0, 0, 0, lambda t: speed * min(1.0, t / 8.0))],
    )
    advance(solver, 100)
    gained = solver.energies()[:2].sum()
    assert gained > 1e-5
    assert solver.work_now == pytest.approx(gained, rel=1e-3)

"""Stages of a step, each against dense matrices and sums over the points."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.boundary.absorbing import Absorbing
from gimpmd_gimp.boundary.body_force import BodyForce
from gimpmd_gimp.boundary.condition import Kick
from gimpmd_gimp.boundary.prescribed_velocity import PrescribedVelocity
from gimpmd_gimp.step.damping import DampingRegion
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver
from gimpmd_schemas.errors import BackendError
from tests.physics.gimp.bodies import UNIT, body
from tests.services.gimp.dense import disturb, hooke, weights_of

SPAN = 0.2


def made(*conditions, initial=disturb, **method) -> Solver:
    choices = {"integrator": "musl", "xpic_every": 0} | method
    options = {"periodic": (False, False), "conditions": conditions}
    return body((5, 4), Method(**choices), SPAN, initial, **options)


def kick_of(solver: Solver) -> Kick:
    return Kick(0, [0], solver.time, np.array([SPAN]))


def nodal_mass(solver: Solver) -> np.ndarray:
    return weights_of(solver)[0].T @ solver.points.mass


@pytest.mark.parametrize("configuration", ["current", "reference"])
def test_project_is_the_consistent_average(configuration) -> None:
    """Paper Eq. 16."""
    solver = made(configuration=configuration)
    S, p = weights_of(solver)[0], solver.points
    solver.V[:] = np.nan
    solver.stages.project()
    M, used = nodal_mass(solver), nodal_mass(solver) > 1e-12
    np.testing.assert_allclose(solver.M, M, atol=1e-15)
    expected = (S.T @ (p.mass[:, None] * p.v))[used] / M[used, None]
    np.testing.assert_allclose(solver.V[used], expected, atol=1e-14)
    np.testing.assert_array_equal(solver.V[~used], 0.0)


def test_push_solves_for_the_change_with_dashpots() -> None:
    """``M dV = span f - C (V + dV / 2)`` with the dashpots C of an absorbing face."""
    solver = made(Absorbing(0, 1))
    G, p, nodes = weights_of(solver)[1], solver.points, solver.nodes
    M, used = nodal_mass(solver), nodal_mass(solver) > 1e-12
    f = -np.einsum("p,pij,pnj->ni", p.volume, hooke(p.F, UNIT.lame, UNIT.shear), G)
    solver.stages.project()
    before = nodes.V.copy()
    solver.stages.push(kick_of(solver))
    C = nodes.dashpot
    assert C.sum(axis=0) == pytest.approx(SPAN * 4.0 * np.array([1.0, (1.0 / 3.0) ** 0.5]))
    left = M[:, None] * nodes.dV + C * (before + 0.5 * nodes.dV)
    np.testing.assert_allclose(left[used], SPAN * f[used], atol=1e-15)
    # what the dashpots did is the load
    np.testing.assert_allclose(nodes.loads, -C * (before + 0.5 * nodes.dV), atol=1e-15)


def test_a_prepared_push_is_the_same() -> None:
    plain, prepared = (made(configuration="reference") for _ in range(2))
    half = Kick(0, [0], 0.0, np.array([0.5 * SPAN]))  # the first kick of MUSL
    prepared.stages.prepare()
    for solver in (plain, prepared):
        solver.stages.push(half)
    np.testing.assert_array_equal(plain.nodes.dV, prepared.nodes.dV)
    # a kick of another length has to sum the stress again
    prepared.stages.prepare()
    prepared.stages.discard_prepared()
    prepared.stages.push(kick_of(prepared))
    np.testing.assert_allclose(prepared.nodes.dV, 2.0 * plain.nodes.dV, rtol=1e-14)
    # and so has the push after a prepared one
    prepared.stages.prepare()
    prepared.stages.push(half)
    prepared.points.F[:] = np.eye(2)
    prepared.stages.push(half)
    np.testing.assert_array_equal(prepared.nodes.dV, 0.0)


def test_sum_loads_is_the_impulse_of_loads_alone() -> None:
    solver = made(BodyForce(lambda X, time: X + time))
    kick = Kick(0, [0], 2.0, np.array([SPAN]))
    solver.nodes.loads[:] = np.nan
    solver.stages.sum_loads(kick)
    S, p = weights_of(solver)[0], solver.points
    expected = S.T @ (p.mass[:, None] * SPAN * (p.reference + 2.0))
    np.testing.assert_allclose(solver.nodes.loads, expected, atol=1e-14)


def test_kick_changes_velocities_and_sums_energy_in_its_middle() -> None:
    """Paper Eq. 5; the first kick starts at its middle, where velocities at half steps begin."""
    solver = made()
    (S, _), p, stages = weights_of(solver), solver.points, solver.stages
    stages.project()
    for first in (True, False):
        solver.clock.start_kick([0])
        stages.push(kick_of(solver))
        before, change = p.v.copy(), S @ solver.nodes.dV
        stages.kick(kick_of(solver))
        solver.clock.advance()
        np.testing.assert_allclose(p.v, before + change, atol=1e-15)
        np.testing.assert_allclose(p.dv, change, atol=1e-15)
        np.testing.assert_allclose(solver.nodes.P, S.T @ (p.mass[:, None] * p.v), atol=1e-15)
        middle = before + (0.0 if first else 0.5) * change
        kinetic = 0.5 * p.mass @ (middle**2).sum(axis=1)
        expected = [kinetic, *(p.mass @ middle)]
        np.testing.assert_allclose(stages.kick_sums, expected, atol=1e-15)


def test_prescribed_components_take_their_share() -> None:
    solver = made(PrescribedVelocity(0, 0, 1, lambda time: 0.3))
    stages, V = solver.stages, np.zeros_like(solver.V)
    P = np.random.default_rng(3).normal(size=V.shape)
    stages.solve_velocity(0, P, V, share=0.5)
    face = solver.mesh.positions()[:, 0] <= 0.0
    np.testing.assert_array_equal(V[face, 1], 0.15)
    used = nodal_mass(solver) > 1e-12
    expected = P[used] / nodal_mass(solver)[used, None]
    np.testing.assert_allclose(V[used, 0], expected[:, 0], rtol=1e-13)
    np.testing.assert_allclose(V[used & ~face, 1], expected[~face[used], 1], rtol=1e-13)


def test_damped_points_leave_their_new_momentum_on_the_nodes() -> None:
    """Decay over the kick: velocities shrink by ``exp(-rate span)``, and so does the momentum."""

    def uniform(p) -> None:
        p.v[:] = (0.1, 0.2)

    solver = made(initial=uniform, damping=(DampingRegion(rate=0.5),))
    used = nodal_mass(solver) > 1e-6
    solver.step()
    shrunk = np.exp(-0.5 * 0.5 * SPAN) * np.array([0.1, 0.2])
    np.testing.assert_allclose(solver.points.v, np.tile(shrunk, (80, 1)), rtol=1e-13)
    np.testing.assert_allclose(solver.V[used], np.tile(shrunk, (used.sum(), 1)), rtol=1e-12)


def test_deforming_and_moving_take_a_part_of_the_step() -> None:
    solver = made()
    (S, G), p, stages = weights_of(solver), solver.points, solver.stages
    V = solver.V[:] = np.random.default_rng(4).normal(size=solver.V.shape)
    F, x = p.F.copy(), p.x.copy()
    solver.body.run(*stages.deforming([0], 0.5, move=False))
    L = np.einsum("ni,pnj->pij", V, G)
    np.testing.assert_allclose(p.F, F + 0.5 * SPAN * L, atol=1e-14)
    np.testing.assert_array_equal(p.x, x)
    solver.body.run(*stages.moving([0]))
    np.testing.assert_allclose(p.x, x + SPAN * S @ V, atol=1e-14)


def test_a_kinetic_energy_that_is_not_finite_ends_the_run() -> None:
    solver = made(configuration="reference")
    solver.points.v[7, 1] = np.inf
    with pytest.raises(BackendError, match=r"kinetic energy is not finite at t = 0; .*reduce"):
        solver.step()

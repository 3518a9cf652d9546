"""Forces per mass on all points: free fall is exact, and a force per place is its integral."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.boundary.body_force import BodyForce
from gimpmd_gimp.boundary.condition import Kick
from gimpmd_gimp.step.integrators import INTEGRATORS
from gimpmd_gimp.step.method import Method
from tests.physics.gimp.bodies import body, step_all
from tests.services.gimp.dense import weights_of

DT = 0.25
GRAVITY = np.array([0.02, -0.03, 0.01])


def uniform(X: np.ndarray, time: float) -> np.ndarray:
    return np.tile(GRAVITY[: X.shape[1]], (len(X), 1))


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("cells", [(6,), (4, 3), (2, 2, 3)], ids=["1-D", "2-D", "3-D"])
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_free_fall_is_exact(integrator, cells, periodic) -> None:
    """``u = g t^2 / 2`` where velocities stand in the middle of steps; Euler's with theirs at ends.

    Nothing strains, and every point has the velocity ``g t`` at its time.
    """
    method = Method(integrator, xpic_every=0, configuration="reference")
    options = {"periodic": (periodic,) * len(cells), "conditions": [BodyForce(uniform)]}
    solver = body(cells, method, DT, lambda p: None, **options)
    g = GRAVITY[: len(cells)]
    for _ in range(12):
        solver.step()
        p, t = solver.points, solver.time
        late = DT if integrator in ("usl", "usf") else 0.0
        u = np.tile(0.5 * t * (t + late) * g, (p.count, 1))
        np.testing.assert_allclose(p.x - p.reference, u, rtol=1e-9)
        v = np.tile(solver.clock.velocity_time[0] * g, (p.count, 1))
        np.testing.assert_allclose(p.v, v, rtol=1e-12)
        np.testing.assert_allclose(p.F, np.tile(np.eye(p.dim), (p.count, 1, 1)), atol=1e-12)


def test_a_falling_body_crosses_the_grid() -> None:
    """In the current configuration points change their cells, and the fall stays exact."""
    method = Method("usavg", xpic_every=0)
    solver = body((4, 4), method, DT, lambda p: None, conditions=[BodyForce(uniform)])
    while solver.time < 20.0:
        solver.step()
    p = solver.points
    u = np.tile(0.5 * solver.time**2 * GRAVITY[:2], (p.count, 1))
    assert np.abs(u).max() > 5.0
    np.testing.assert_allclose(p.x - p.reference, u, rtol=1e-9)
    np.testing.assert_allclose(p.F, np.tile(np.eye(2), (p.count, 1, 1)), atol=1e-10)


def test_the_nodal_force_is_that_of_reference_positions_and_of_the_time_of_the_kick() -> None:
    """``f_i = sum_p S_ip m_p b(X_p, t)``."""
    method = Method("musl", xpic_every=0)
    load = BodyForce(lambda X, time: time * X**2)
    options = {"periodic": (False, False), "conditions": [load]}
    solver = body((4, 3), method, DT, lambda p: None, **options)
    p = solver.points
    p.x += 0.05
    solver.refresh()
    S, _ = weights_of(solver)
    solver.stages.sum_loads(Kick(0, [0], 3.0, np.array([0.5])))
    expected = S.T @ (p.mass[:, None] * 0.5 * 3.0 * p.reference**2)
    np.testing.assert_allclose(solver.nodes.loads, expected, atol=1e-14)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_levels_together_gain_the_whole_momentum(integrator) -> None:
    method = Method(integrator, xpic_every=0)
    options = {"finer": ((((8, 24), (8, 24)),),), "conditions": [BodyForce(uniform)]}
    solver = body((16, 16), method, DT, lambda p: None, **options)
    for _ in range(4):
        step_all(solver)
    exact = 256.0 * solver.time * GRAVITY[:2]
    assert solver.energies()[3:] == pytest.approx(exact, rel=1e-12)

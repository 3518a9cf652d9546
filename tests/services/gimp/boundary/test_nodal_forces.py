"""Forces on nodes from outside the continuum: what they give to the body."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.boundary.condition import Kick
from gimpmd_gimp.boundary.nodal_forces import NodalForces
from gimpmd_gimp.step.dispersion import correction
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver
from tests.physics.gimp.bodies import body, step_all

CLOSE = ((((8, 40), (8, 40)),), (((32, 64), (32, 48)),))
"""Boxes in 24 x 24 cells, with as little between rims as a case may have."""

FORCE = np.array([2e-4, -1e-4])


class Push:
    """A constant force on the node of the finest level that is closest to a place."""

    def __init__(self, mesh, place, force):
        nodes = np.flatnonzero((mesh.level == mesh.hierarchy.top) & mesh.basis)
        self.node = nodes[np.argmin(np.abs(mesh.positions()[nodes] - place).sum(axis=1))]
        self.force = np.array(force)

    def add(self, span, J):
        J[self.node] += span * self.force


def free(finer=(), **method) -> Solver:
    choices = Method(**{"integrator": "musl", "configuration": "reference"} | method)
    return body((24, 24), choices, 0.4, lambda p: None, periodic=(False, False), finer=finer)


@pytest.mark.parametrize("finer", [(), CLOSE], ids=["one level", "three levels"])
@pytest.mark.parametrize("beta", [0.0, correction(0.25)], ids=["plain", "corrected"])
def test_forces_from_outside_give_their_momentum(finer, beta):
    solver = free(finer, dispersion=beta)
    solver.add_condition(NodalForces(Push(solver.mesh, [11.0, 10.5], FORCE).add))
    for _ in range(12):
        before = solver.time
        exact = solver.energies()[3:]
        step_all(solver)
        # the kick at a common time is of all the forces there: coarse levels know no force
        assert solver.stages.kick_sums[1:] == pytest.approx(exact, abs=1e-15)
        assert exact == pytest.approx(before * FORCE, abs=1e-15)
    # the push does work on what it moves
    assert np.abs(solver.points.v).max() > 1e-5


def test_a_kick_adds_the_impulse_to_the_internal_ones() -> None:
    """For the code that gives the forces counts their work, and they act on the finest level."""
    solver = free(CLOSE)
    solver.add_condition(NodalForces(Push(solver.mesh, [12.25, 10.0], FORCE).add))
    (condition,) = solver.conditions
    spans = np.array([0.4, 0.2, 0.1])
    solver.nodes.impulse[:] = 1.0
    for level in (0, 1):
        condition.add_impulse(Kick(0, [0, 1, 2], 0.0, spans), level)
    np.testing.assert_array_equal(solver.nodes.impulse, 1.0)
    condition.add_impulse(Kick(0, [0, 1, 2], 0.0, spans), 2)
    (node,) = np.flatnonzero((solver.nodes.impulse != 1.0).any(axis=1))
    assert solver.mesh.positions()[node].tolist() == [12.25, 10.0]
    np.testing.assert_allclose(solver.nodes.impulse[node], 1.0 + 0.1 * FORCE, rtol=1e-13)
    step_all(solver)
    solver.energies()
    assert solver.work_now == 0.0


def test_forces_act_at_once_on_the_first_acceleration() -> None:
    """``a_p = sum_i S_ip f_i / M_i``; a node inside a body of density 1 has the mass of a cell."""
    solver = free(integrator="usl")
    solver.add_condition(NodalForces(Push(solver.mesh, [11.0, 10.0], FORCE).add))
    solver.step()
    p = solver.points
    nearest = np.abs(p.reference - (11.25, 10.25)).sum(axis=1) < 1e-9
    weight = 0.75**2  # of the linear function, in the middle of whose piece the point lies
    np.testing.assert_allclose(p.v[nearest], [weight * 0.4 * FORCE], rtol=1e-12)

"""Work of the loads against the change of energy of bodies whose motion is known."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.boundary.body_force import BodyForce
from gimpmd_gimp.boundary.traction import Traction
from gimpmd_gimp.step.integrators import INTEGRATORS
from gimpmd_gimp.step.method import Method
from tests.physics.gimp.bodies import body
from tests.services.gimp.dense import weights_of

GRAVITY, VELOCITY = np.array([0.02, -0.01]), np.array([0.05, 0.02])
DT = 0.25


def moving(p) -> None:
    p.v[:] = VELOCITY


def gravity() -> BodyForce:
    return BodyForce(lambda X, time: np.tile(GRAVITY, (len(X), 1)))


@pytest.mark.parametrize("configuration", ["current", "reference"])
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_rigid_body_gains_the_work_of_a_constant_force(integrator, configuration) -> None:
    """In free fall nothing strains, so the kinetic energy is all; at half steps it is exact too.

    At whole steps the leapfrog of MUSL keeps an energy that differs from that of the start by a
    constant, ``m dV^2 / 8`` of the kick in which the force sets in. In the current configuration
    loads reach nodes that had no velocity before, for a few millionths of the work.
    """
    method = Method(integrator, xpic_every=0, configuration=configuration)
    options = {"periodic": (False, False), "conditions": [gravity()]}
    solver = body((6, 4), method, DT, moving, **options)
    mass = solver.points.mass.sum()
    start = 0.5 * mass * VELOCITY @ VELOCITY
    onset = mass * (DT * GRAVITY) @ (DT * GRAVITY) / 8.0 if integrator == "musl" else 0.0
    bound = 2e-5 if (integrator, configuration) == ("musl", "current") else 1e-10
    for _ in range(6):
        solver.step()
        p = solver.points
        of_points = 0.5 * p.mass @ (p.v**2).sum(axis=1)
        assert of_points - start == pytest.approx(solver.work.external, rel=bound)
        kinetic, strain = solver.energies()[:2]
        assert strain < 1e-20
        assert kinetic - start - onset == pytest.approx(solver.work_now, rel=bound)
    assert solver.work_now > 0.1 * start


def test_work_is_that_of_the_nodes_that_count() -> None:
    """Every node of a rigid body has its mass as share of the work."""
    method = Method("usl", xpic_every=0, configuration="reference")
    options = {"periodic": (False, False), "conditions": [gravity()]}
    solver = body((6, 4), method, DT, moving, counted=lambda x: x[:, 0] < 2.5, **options)
    for _ in range(4):
        solver.step()
    S, _ = weights_of(solver)
    mass = S.T @ solver.points.mass
    left = mass[solver.mesh.positions()[:, 0] < 2.5].sum()
    gained = solver.energies()[0] - 0.5 * 24.0 * VELOCITY @ VELOCITY
    assert solver.work_now == pytest.approx(left / mass.sum() * gained, rel=1e-12)


@pytest.mark.parametrize("integrator", ["usavg", "musl"])
def test_an_elastic_body_gains_the_work_of_a_traction(integrator) -> None:
    """Kinetic and strain energy together, to the second order of the time step."""
    errors = []
    for dt in (0.4, 0.2):
        pull = Traction(0, 1, (1e-3, 5e-4), lambda time: np.sin(0.3 * time))
        method = Method(integrator, xpic_every=0, configuration="reference")
        options = {"periodic": (False, False), "conditions": [pull]}
        solver = body((8, 4), method, dt, lambda p: None, **options)
        for _ in range(round(12.0 / dt)):
            solver.step()
        kinetic, strain = solver.energies()[:2]
        assert min(kinetic, strain) > 0.05 * solver.work_now
        errors.append(abs((kinetic + strain) / solver.work_now - 1.0))
    assert errors[0] < 0.02
    assert errors[1] < 0.3 * errors[0]


def test_without_loads_there_is_no_work() -> None:
    solver = body((4, 4), Method("musl", xpic_every=0), DT, moving)
    solver.step()
    assert solver.energies()[0] > 0.0
    assert (solver.work.external, solver.work.interface, solver.work_now) == (0.0, 0.0, 0.0)

"""Energies, mass and momentum of groups of points, and velocities at the present time."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.boundary.body_force import BodyForce
from gimpmd_gimp.points.groups import ALL
from gimpmd_gimp.step.energies import (
    bring_to_present,
    present_velocities,
    strain_energy,
    sum_energies,
)
from gimpmd_gimp.step.integrators import INTEGRATORS
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver
from tests.physics.gimp.bodies import UNIT, body, step_all
from tests.services.gimp.dense import disturb, hooke

GRAVITY = np.array([0.02, -0.01])
NESTED = ((((8, 24), (8, 24)),),)


def density(F: np.ndarray) -> np.ndarray:
    """Energy per volume of Hooke's law: half the stress times the strain."""
    strain = 0.5 * (F + F.swapaxes(1, 2)) - np.eye(F.shape[1])
    return 0.5 * (hooke(F, UNIT.lame, UNIT.shear) * strain).sum(axis=(1, 2))


@pytest.mark.parametrize("cells", [(6,), (4, 3), (2, 2, 3)], ids=["1-D", "2-D", "3-D"])
def test_energies_of_a_group_are_the_sums_over_its_points(cells) -> None:
    solver = body(cells, Method("musl", xpic_every=0), 0.2, disturb)
    p = solver.points
    left = p.reference[:, 0] < 1.1
    v = np.random.default_rng(1).normal(size=p.v.shape)
    for group, mask in ((ALL, left | True), (solver.body.add_group(left), left)):
        strain = p.volume[mask] @ density(p.F[mask])
        kinetic = 0.5 * p.mass[mask] @ (v[mask] ** 2).sum(axis=1)
        mass, momentum = p.mass[mask].sum(), p.mass[mask] @ v[mask]
        found = sum_energies(solver.body, v, group)
        assert found == pytest.approx([kinetic, strain, mass, *momentum], rel=1e-13)
        assert strain_energy(solver.body, group) == pytest.approx([strain, mass], rel=1e-13)


def falling(integrator: str, finer=()) -> Solver:
    """A periodic body in free fall."""

    def moving(p) -> None:
        p.v[:] = (0.1, 0.2)

    method = Method(integrator, xpic_every=0, configuration="reference")
    load = BodyForce(lambda X, time: np.tile(GRAVITY, (len(X), 1)))
    options = {"periodic": (True, True), "finer": finer, "conditions": [load]}
    return body((16, 16), method, 0.4, moving, **options)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_velocities_are_brought_to_the_present_and_back(integrator) -> None:
    """Free fall: ``v = v_0 + g t`` at the present time."""
    solver = falling(integrator)
    for _ in range(3):
        solver.step()
        exact = np.array([0.1, 0.2]) + solver.time * GRAVITY
        v, _ = present_velocities(solver.stages, exact=True)
        np.testing.assert_allclose(v, np.broadcast_to(exact, v.shape), rtol=1e-13)
        quick, _ = present_velocities(solver.stages, exact=False)
        np.testing.assert_allclose(quick, v, rtol=1e-13)  # the force is constant
        brought = solver.points.v.copy()
        bring_to_present(solver.stages, brought, 1.0)
        np.testing.assert_array_equal(brought, v)
        bring_to_present(solver.stages, brought, -1.0)
        np.testing.assert_allclose(brought, solver.points.v, rtol=1e-14)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_momentum_of_levels_that_know_their_velocities_at_different_times(integrator) -> None:
    solver = falling(integrator, NESTED)
    for _ in range(3):
        step_all(solver)
        exact = 256.0 * (np.array([0.1, 0.2]) + solver.time * GRAVITY)
        assert solver.energies()[3:] == pytest.approx(exact, rel=1e-13)


def test_the_quick_way_is_of_second_order() -> None:
    """It takes the last kick in place of the next one, which is a step away."""
    errors = []
    for dt in (0.2, 0.1):
        wave = np.pi / 8.0

        def shake(p, wave: float = wave) -> None:
            p.v[:, 0] = 1e-3 * np.sin(wave * p.reference[:, 0])

        method = Method("musl", xpic_every=0, configuration="reference")
        solver = body((16, 2), method, dt, shake)
        for _ in range(round(3.0 / dt)):
            solver.step()
        exact, quick = (present_velocities(solver.stages, exact)[0] for exact in (True, False))
        errors.append(np.abs(quick - exact).max())
    assert 0.0 < errors[1] < 0.3 * errors[0]


def test_energies_between_the_steps_of_a_coarse_level_are_refused() -> None:
    solver = falling("musl", NESTED)
    solver.step()
    with pytest.raises(ValueError, match="every 2 steps"):
        solver.energies()

"""What prescribed velocities and displacements share: nodes, change, and the work that it needs."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.boundary.prescribed import driven
from gimpmd_gimp.boundary.prescribed_velocity import PrescribedVelocity
from gimpmd_gimp.step.integrators import INTEGRATORS
from gimpmd_gimp.step.method import Method
from gimpmd_schemas.case.conditions import Face
from gimpmd_schemas.case.face_parts import FacePart
from gimpmd_schemas.case.profiles import Linear, Value
from tests.physics.gimp.bodies import body
from tests.services.gimp.dense import disturb

MIDDLE = ((((8, 24), (0, 32)),),)
"""Touches the lower and the upper face of 16 x 16 cells in their middle."""


@pytest.mark.parametrize("side", [0, 1])
def test_the_nodes_of_a_face_are_those_of_the_basis_on_every_level(side) -> None:
    held = PrescribedVelocity(1, side, 0, lambda _: 0.5)
    options = {"periodic": (False, False), "finer": MIDDLE, "conditions": [held]}
    solver = body((16, 16), Method("usl", xpic_every=0), 0.2, lambda p: None, **options)
    solver.step()
    mesh, x = solver.mesh, solver.mesh.positions()
    on_face = x[:, 1] >= 16.0 if side else x[:, 1] <= 0.0
    moving = solver.V[:, 0] == 0.5
    np.testing.assert_array_equal(moving & mesh.basis, on_face & mesh.basis)
    assert set(mesh.level[moving & mesh.basis]) == {0, 1}
    assert (solver.V[on_face & (solver.M > 0.0), 0] > 0.49).all()  # hanging nodes as well


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_the_impulse_of_the_face_is_a_load(integrator) -> None:
    """All momentum of a free body comes from the face that moves it."""
    held = [PrescribedVelocity(0, 0, i, lambda t, i=i: 0.1 * (i + t)) for i in (0, 1)]
    method = Method(integrator, xpic_every=0, configuration="reference")
    options = {"periodic": (False, False), "conditions": held}
    solver = body((5, 4), method, 0.2, disturb, **options)
    p = solver.points
    for _ in range(5):
        before = p.mass @ p.v
        solver.step()
        given = solver.nodes.loads.sum(axis=0)
        np.testing.assert_allclose(p.mass @ p.v - before, given, atol=1e-14)
    assert np.abs(given).max() > 1e-3


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("configuration", ["current", "reference"])
def test_the_work_of_a_face_on_two_levels_is_the_energy_of_the_body(integrator, configuration):
    """A plate that is pushed: nodes beside the finer level get impulses in its steps too."""
    pushed = PrescribedVelocity(0, 0, 0, lambda time: 1e-3 * min(time / 16.0, 1.0))
    method = Method(integrator, xpic_every=0, configuration=configuration)
    beside = ((((0, 16), (0, 16)),),)
    options = {"periodic": (False, False), "finer": beside, "conditions": [pushed]}
    solver = body((32, 16), method, 0.2, lambda p: None, **options)
    missing, work = [], []
    while solver.time < 40.0:
        solver.step()
        if solver.clock.synchronous():
            energies = solver.tally()
            work.append(energies.external_work)
            missing.append(energies.kinetic + energies.potential - work[-1])
    assert max(np.abs(missing)) < 0.01 * work[-1]


def part(value: Value) -> FacePart:
    face = Face(condition="velocity", value=value, ramp=2.0)
    box = ((0.0, 1.0),) * 3
    return FacePart(1, 1, "boundary.top", face, box, np.eye(6))


def test_components_have_axes_and_values_over_time() -> None:
    found = {axis: value for axis, value, _ in driven(part((None, 3.0, -1.0)))}
    assert sorted(found) == [1, 2]
    for time, factor in ((0.0, 0.0), (0.5, 0.25), (4.0, 1.0)):
        assert found[1](time) == pytest.approx(3.0 * factor)
        assert found[2](time) == pytest.approx(-factor)


def test_components_of_a_profile_depend_on_position() -> None:
    gradient = ((2.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    profile = Linear(value=(1.0, None, None), gradient=gradient)
    ((axis, value, shape),) = driven(part(profile))
    assert (axis, value(1.0)) == (0, 0.5)
    assert shape is not None
    np.testing.assert_allclose(shape(np.array([[0.0, 1, 0], [0.5, 1, 9]])), [1.0, 2.0])


def test_only_the_nodes_of_the_part_are_driven() -> None:
    """Half-open: the node on the upper end of the part belongs to the next part."""
    region = ((4.0, 8.0), (-np.inf, np.inf))
    held = PrescribedVelocity(1, 1, 0, lambda _: 0.5, region)
    options = {"periodic": (False, False), "conditions": [held]}
    solver = body((16, 16), Method("usl", xpic_every=0), 0.2, lambda p: None, **options)
    solver.step()
    x = solver.mesh.positions()
    moving = (solver.V[:, 0] == 0.5) & (x[:, 1] == 16.0)
    assert sorted(x[moving, 0]) == [4.0, 5.0, 6.0, 7.0]

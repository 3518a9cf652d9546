"""Prescribed displacements: followed exactly at every step by all that hangs on them."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.boundary.prescribed_displacement import FACE_CONDITIONS, PrescribedDisplacement
from gimpmd_gimp.step.integrators import INTEGRATORS
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver
from gimpmd_schemas.case.conditions import Face
from gimpmd_schemas.mechanics.units import UNITS
from tests.physics.gimp.bodies import body


def bar(cells, integrator, *conditions, finer=()) -> Solver:
    """At rest; periodic along y."""
    method = Method(integrator, xpic_every=0)
    options = {"periodic": (False, True), "finer": finer, "conditions": conditions}
    return body(cells, method, 0.4, lambda p: None, **options)


def swing(time):
    """A displacement that starts smoothly, swings, and stops short at t = 30."""
    time = min(max(time, 0.0), 30.0)
    return 0.02 * np.sin(0.3 * time) ** 2 + 1e-4 * time**2


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_points_that_hang_on_driven_nodes_alone_follow_a_displacement(integrator):
    """All nodes of a bar one cell wide are on a driven face or beyond."""
    driven = [PrescribedDisplacement(0, side, 0, swing) for side in (0, 1)]
    solver = bar((1, 4), integrator, *driven)
    for _ in range(120):
        solver.step()
        p = solver.points
        u = p.x - p.reference
        assert u[:, 0] == pytest.approx(swing(solver.time), abs=1e-13)
        assert np.abs(u[:, 1]).max() < 1e-15
        if integrator != "usf":  # whose strains are a step behind
            assert np.abs(p.F - np.eye(2)).max() < 1e-13
    assert solver.time > 40.0


@pytest.mark.parametrize("integrator", ["usavg", "musl"])
@pytest.mark.parametrize("finer", [(), ((((0, 32), (0, 16)),),)], ids=["one level", "two levels"])
def test_a_bar_is_stretched_by_the_displacement_of_its_face(integrator, finer):
    """At rest a bar fixed at one end has the strain of the other end's displacement."""

    def stretch(time):
        return 0.016 * np.clip(time / 64.0, 0.0, 1.0)

    driven = [
        PrescribedDisplacement(0, 0, 0, lambda _: 0.0),
        PrescribedDisplacement(0, 1, 0, stretch),
    ]
    solver = bar((16, 8), integrator, *driven, finer=finer)
    while solver.time < 70.0:
        solver.step()
    strain = []
    while solver.time < 134.0:
        solver.step()
        strain.append(solver.points.F[:, 0, 0].mean() - 1.0)
    # the outermost nodes stand for points inside (kinematics of GIMP at a face)
    assert np.mean(strain) == pytest.approx(1e-3, rel=0.03)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("finer", [(), ((((0, 16), (0, 8)),),)], ids=["one level", "two levels"])
def test_velocities_of_the_face_add_up_to_its_displacement(integrator, finer) -> None:
    """The nodal velocity after a step is the mean over the step, for every integrator."""
    solver = bar((8, 4), integrator, PrescribedDisplacement(0, 1, 1, swing), finer=finer)
    mesh, top = solver.mesh, solver.top
    (node,) = mesh.find(top, np.array([[mesh.hierarchy.count(top)[0], 2]]))
    moved = 0.0
    for _ in range(30):
        solver.step()
        moved += solver.dt * solver.V[node, 1]
        assert moved == pytest.approx(swing(solver.time), abs=1e-13)


def test_a_face_prescribes_the_components_that_it_names() -> None:
    face = Face(condition="displacement", value=(None, 0.2), ramp=4.0)
    (made,) = FACE_CONDITIONS["displacement"](0, 1, face, UNITS["metal"])
    solver = bar((4, 2), "musl", made)
    solver.step()
    on_face = solver.mesh.positions()[:, 0] >= 4.0
    expected = 0.2 / 4.0  # displacement over the time of the ramp
    np.testing.assert_allclose(solver.V[on_face, 1], expected, rtol=1e-14)
    np.testing.assert_array_equal(solver.V[on_face, 0], 0.0)

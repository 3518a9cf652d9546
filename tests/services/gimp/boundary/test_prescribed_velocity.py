"""Prescribed velocities: the nodes of a face have them, and their work is the body's energy."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.boundary.prescribed_velocity import FACE_CONDITIONS, PrescribedVelocity
from gimpmd_gimp.setup import make_solver
from gimpmd_gimp.step.integrators import INTEGRATORS
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver
from gimpmd_schemas.case.conditions import Face
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.mechanics.units import UNITS
from tests.physics.gimp.bodies import body, total_energy
from tests.services.gimp.dense import disturb


def bar(integrator, *conditions, finer=(), initial=disturb) -> Solver:
    method = Method(integrator, xpic_every=0)
    options = {"periodic": (False, True), "finer": finer, "conditions": conditions}
    return body((8, 4), method, 0.2, initial, **options)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("finer", [(), ((((0, 16), (0, 8)),),)], ids=["one level", "two levels"])
def test_nodes_on_the_face_and_beyond_have_the_velocity(integrator, side, finer) -> None:
    """At the time at which the velocities of their level are known."""
    solver = bar(integrator, PrescribedVelocity(0, side, 1, lambda t: 0.1 + 0.3 * t), finer=finer)
    mesh, x = solver.mesh, solver.mesh.positions()[:, 0]
    face = mesh.basis & (x >= 8.0 if side else x <= 0.0)
    for _ in range(3 * 2**solver.top):
        solver.step()
        for level in solver.clock.levels:
            here = face & (mesh.level == level)
            known = 0.1 + 0.3 * solver.clock.velocity_time[level]
            np.testing.assert_allclose(solver.V[here, 1], known, rtol=1e-13)
    assert face.sum() >= 3 * 4
    assert np.abs(solver.V[face, 0]).max() > 1e-3  # the other component is free


@pytest.mark.parametrize("integrator", ["usavg", "musl"])
def test_a_body_between_driven_faces_takes_their_velocity(integrator) -> None:
    """All nodes of a bar one cell wide are prescribed, so the points move as the faces do."""
    method = Method(integrator, xpic_every=0)
    driven = [PrescribedVelocity(0, side, 0, lambda t: 0.02 * t) for side in (0, 1)]
    options = {"periodic": (False, True), "conditions": driven}
    solver = body((1, 2), method, 0.2, lambda p: None, **options)
    for _ in range(20):
        solver.step()
        exact = 0.02 * solver.clock.velocity_time[0]
        np.testing.assert_allclose(solver.points.v[:, 0], exact, rtol=1e-12)
    kinetic = 0.5 * solver.points.mass.sum() * exact**2
    assert solver.work.external == pytest.approx(kinetic, rel=1e-5)


def test_driven_face_works_on_the_body(build):
    """Energy gained equals the work of the face's reaction."""
    case = build(
        domain={"box": [[0.0, 32.0], [0.0, 2.0]], "periodic": [False, True]},
        boundary={"right": {"condition": "velocity", "value": [1e-3, None], "ramp": 4.0}},
    )
    solver = make_solver(make_plan(case))
    for _ in range(60):
        solver.step()
    assert total_energy(solver) == pytest.approx(solver.work_now, rel=0.02)
    rim = solver.points.reference[:, 0] > 31.0
    # the outermost point still trails the face by the grid's ripple behind the front
    assert solver.points.v[rim, 0] == pytest.approx(1e-3, rel=0.05)


def test_components_that_a_face_names() -> None:
    face = Face(condition="velocity", value=(0.5, None), ramp=2.0)
    (made,) = FACE_CONDITIONS["velocity"](0, 1, face, UNITS["lj"])
    assert made.velocity(0, 1.0) == pytest.approx(0.25)
    assert made.velocity(0, 5.0) == pytest.approx(0.5)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_plane_of_symmetry_holds_the_normal_component(axis) -> None:
    """A body between planes of symmetry is half of one that repeats and is its own mirror image."""
    planes = [FACE_CONDITIONS["symmetry"](axis, s, Face(), UNITS["lj"])[0] for s in (0, 1)]

    def wave(p) -> None:
        phase = np.pi / 8.0 * p.reference[:, axis]
        p.v[:, axis], p.v[:, 1 - axis] = 1e-6 * np.sin(phase), 2e-6 * np.cos(phase)

    cells, periodic = [4, 4], [True, True]
    cells[axis], periodic[axis] = 8, False
    method = Method("usavg", xpic_every=0)
    half = body(tuple(cells), method, 0.2, wave, periodic=tuple(periodic), conditions=planes)
    cells[axis] = 16
    whole = body(tuple(cells), method, 0.2, wave)
    for _ in range(40):
        half.step()
        whole.step()
    p, q = half.points, whole.points
    there = np.flatnonzero(q.reference[:, axis] < 8.0)
    there = there[np.lexsort(q.reference[there].T)]
    here = np.lexsort(p.reference.T)
    np.testing.assert_array_equal(p.reference[here], q.reference[there])
    inside = np.abs(p.reference[here, axis] - 4.0) < 3.0
    size = np.abs(q.v).max()
    assert np.abs(p.v[here] - q.v[there])[inside].max() < 0.02 * size

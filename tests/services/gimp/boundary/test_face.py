"""Points along a face of the domain, and forces spread over their outer faces."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.boundary.face import FaceLoad, find_face_loads, outermost_points
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver
from tests.physics.gimp.bodies import body
from tests.services.gimp.dense import hat

NESTED = ((((0, 16), (8, 32)),),)
"""In 16 x 16 cells: on the left face, and on part of the upper one."""


def square(finer=(), initial=lambda p: None, **method) -> Solver:
    choices = Method(**{"integrator": "musl", "xpic_every": 0} | method)
    return body((16, 16), choices, 0.2, initial, periodic=(False, False), finer=finer)


@pytest.mark.parametrize(("axis", "side"), [(0, 0), (0, 1), (1, 0), (1, 1)])
@pytest.mark.parametrize("finer", [(), NESTED], ids=["one level", "two levels"])
def test_outermost_points_cover_the_face_once(axis, side, finer) -> None:
    solver = square(finer)
    chosen, p = outermost_points(solver.body, axis, side), solver.points
    assert (np.diff(chosen) > 0).all()
    size = 2.0 * p.half[chosen] / 2.0 ** p.level[chosen][:, None]
    face = p.reference[chosen, axis] + (0.5 if side else -0.5) * size[:, axis]
    np.testing.assert_allclose(face, 16.0 * side, atol=1e-13)
    assert size[:, 1 - axis].sum() == pytest.approx(16.0, rel=1e-13)
    assert np.unique(p.reference[chosen, 1 - axis]).size == chosen.size


def test_they_are_the_same_wherever_the_body_has_gone() -> None:
    def gone(p) -> None:
        p.x[:] = p.reference[:, ::-1] + 7.0

    plain, moved = square(configuration="reference"), square((), gone, configuration="reference")
    assert outermost_points(plain.body, 0, 1).size == 32
    np.testing.assert_array_equal(
        outermost_points(moved.body, 0, 1), outermost_points(plain.body, 0, 1)
    )


def test_there_is_one_load_for_each_level_on_the_face() -> None:
    solver = square(NESTED)
    levels = [
        [load.level for load in find_face_loads(solver.body, axis, side, (1.0, 0.0))]
        for axis, side in ((0, 0), (0, 1), (1, 0), (1, 1))
    ]
    assert levels == [[0, 1], [0], [0], [0, 1]]


def test_the_force_follows_the_points_over_the_grid() -> None:
    """On a face between lines of nodes, hat functions share the force between both lines."""
    away = 0.3

    def moved(p) -> None:
        p.x[:, 0] -= away

    solver = square((), moved)
    (load,) = find_face_loads(solver.body, 0, 1, (2.0, 0.0))
    J = np.zeros_like(solver.V)
    load.add(0.5, J)
    x = solver.mesh.positions()
    assert J[:, 0].sum() == pytest.approx(16.0, rel=1e-12)
    for column in (15.0, 16.0, 17.0):
        share = 16.0 * hat(column - (16.0 - away))
        assert J[x[:, 0] == column, 0].sum() == pytest.approx(share, abs=1e-7)


def test_in_the_reference_configuration_it_stays_where_it_was() -> None:
    solver = square(configuration="reference")
    chosen = outermost_points(solver.body, 1, 0)
    load = FaceLoad(solver.body, 1, 0, (0.0, -1.0), 0, chosen)
    first, later = np.zeros_like(solver.V), np.zeros_like(solver.V)
    load.add(1.0, first)
    solver.points.x[:] += 5.0
    solver.points.F[:] *= 2.0
    load.add(1.0, later)
    np.testing.assert_array_equal(first, later)
    load.add(2.0, later)  # it adds
    np.testing.assert_allclose(later, 3.0 * first, rtol=1e-15)


def test_stretched_points_have_longer_faces() -> None:
    """cpGIMP: the domain of a point follows the diagonal of F."""

    def stretched(p) -> None:
        p.F[:, 1, 1] = 1.2

    for interpolation, length in (("ugimp", 16.0), ("cpgimp", 1.2 * 16.0)):
        solver = square((), stretched, interpolation=interpolation)
        J = np.zeros_like(solver.V)
        (load,) = find_face_loads(solver.body, 0, 0, (1.0, 0.0))
        load.add(1.0, J)
        assert J[:, 0].sum() == pytest.approx(length, rel=1e-12)

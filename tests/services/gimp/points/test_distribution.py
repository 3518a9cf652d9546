"""Distribution of points: history variables follow their points through sorting and ranks."""

from __future__ import annotations

import numpy as np

from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.points.distribution import fill, settle, sort
from gimpmd_gimp.points.material_points import MaterialPoints
from tests.services.gimp.ranks import on_ranks

HIERARCHY = Hierarchy((0.0, 0.0), 1.0, (20, 20), (True, True), ((((10, 28), (10, 28)),),))


def marked(mesh: Mesh) -> MaterialPoints:
    """Points whose history variables tell their ids."""
    points = fill(mesh, 2, 1.0, 2)
    points.history[:] = np.stack([points.id, -points.id], axis=1)
    return points


def check(points: MaterialPoints) -> None:
    np.testing.assert_array_equal(points.history[:, 0], points.id)
    np.testing.assert_array_equal(points.history[:, 1], -points.id)


def test_fill_makes_history_variables() -> None:
    assert fill(Mesh(HIERARCHY), 2, 1.0, 3).history.shape[1] == 3
    assert fill(Mesh(HIERARCHY), 2, 1.0).history.shape[1] == 0


def test_sorted_points_keep_their_history() -> None:
    mesh = Mesh(HIERARCHY)
    points = marked(mesh)
    before = points.id.copy()
    points = settle(mesh, points)
    points.x[:, 0] += 3.3
    sort(mesh, points)
    assert (points.id != before).any()
    check(points)


def change_ranks() -> None:
    """Half of the points go to the other rank; called on two ranks."""
    from mpi4py import MPI

    mesh = Mesh(HIERARCHY, MPI.COMM_WORLD)
    points = marked(mesh)
    mine = set(points.id.tolist())
    points.x += 10.0
    points = settle(mesh, points)
    assert points.count > 0
    assert not mine >= set(points.id.tolist())
    check(points)


def test_points_that_change_rank_keep_their_history() -> None:
    on_ranks(2, __file__, "change_ranks")

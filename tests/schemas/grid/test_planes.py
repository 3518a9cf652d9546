"""Planes of the force scheme: which atoms are free, and which nodes ghosts touch."""

from __future__ import annotations

import numpy as np

from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.planes import Interface

INF = np.inf
GRID = BackgroundGrid((0.0, 0.0), 2.0, (10, 8), (False, False))
REGION = ((0.0, 11.0), (3.0, 14.0))
EDGE = Interface(planes=((-INF, 8.5), (5.5, 11.5)), region=REGION)


def test_free_atoms_lie_inside_all_planes() -> None:
    x = np.array([[0.5, 8.0], [8.4, 5.6], [8.6, 8.0], [2.0, 5.4], [2.0, 11.6]])
    assert EDGE.free(x).tolist() == [True, True, False, False, False]
    assert EDGE.core() == ((0.0, 8.5), (5.5, 11.5))


def test_depth_is_the_distance_inward_from_the_nearest_plane() -> None:
    x = np.array([[1.0, 8.0], [8.0, 8.0], [9.5, 8.0], [5.0, 13.0]])
    np.testing.assert_allclose(EDGE.depth(x), [2.5, 0.5, -1.0, -1.5])


def test_ghost_nodes_are_those_whose_hat_functions_reach_a_ghost() -> None:
    rng = np.random.default_rng(1)
    x = rng.uniform([0.0, 3.0], [11.0, 14.0], (20000, 2))
    ghosts = x[~EDGE.free(x)]
    nodes = GRID.positions()
    touched = np.flatnonzero(
        [(np.abs(ghosts - node) < GRID.cell).all(axis=1).any() for node in nodes]
    )
    np.testing.assert_array_equal(EDGE.ghost_nodes(GRID), touched)


def test_without_planes_there_are_no_ghosts() -> None:
    whole = Interface(planes=((-INF, INF), (-INF, INF)), region=((0.0, 20.0), (0.0, 16.0)))
    assert whole.ghost_nodes(GRID).size == 0


def test_planes_of_a_block() -> None:
    grid = BackgroundGrid((0.0, 0.0, 0.0), 2.0, (6, 5, 4), (False, False, False))
    region = ((0.0, 9.0), (3.0, 7.0), (0.0, 8.0))
    interface = Interface(planes=((-INF, 6.5), (-INF, INF), (2.5, 7.5)), region=region)
    assert interface.core() == ((0.0, 6.5), (3.0, 7.0), (2.5, 7.5))
    x = np.random.default_rng(2).uniform([0.0, 3.0, 0.0], [9.0, 7.0, 8.0], (20000, 3))
    free = interface.free(x)
    assert (free == ((x[:, 0] < 6.5) & (x[:, 2] > 2.5) & (x[:, 2] < 7.5))).all()
    touched = [(np.abs(x[~free] - node) < grid.cell).all(axis=1).any() for node in grid.positions()]
    np.testing.assert_array_equal(interface.ghost_nodes(grid), np.flatnonzero(touched))

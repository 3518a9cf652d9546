"""Planes of the force scheme: who is free, and which nodes ghosts touch."""

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


def test_ghost_nodes_are_those_of_hats_that_ghosts_touch() -> None:
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

"""Nodes of the shared grid in the arrays of a solver."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.coupling.nodes import find_nodes
from gimpmd_gimp.step.method import Method
from gimpmd_schemas.grid.background import BackgroundGrid
from tests.physics.gimp.bodies import body

NESTED = ((((8, 24), (8, 24)),),)


@pytest.mark.parametrize("periodic", [(False, False), (True, False)])
def test_ids_lead_to_the_nodes_at_their_positions(periodic) -> None:
    solver = body((6, 4), Method(), 0.2, lambda p: None, periodic=periodic)
    grid = BackgroundGrid((0.0, 0.0), 1.0, (6, 4), periodic)
    x = grid.positions()
    inside = np.flatnonzero(((x >= 0.0) & (x <= (6.0, 4.0))).all(axis=1))
    rows = find_nodes(solver, grid, inside)
    assert (rows >= 0).all()
    away = solver.mesh.positions()[rows] - x[inside]
    away[:, 0] %= 6.0 if periodic[0] else np.inf
    np.testing.assert_array_equal(away, 0.0)
    images = x[inside, 0] == 6.0
    assert (np.isin(rows[images], rows[~images])).all() == periodic[0]


def test_the_shared_grid_is_the_finest_level() -> None:
    """Where the finest level is not, there are no nodes."""
    solver = body((16, 16), Method(), 0.2, lambda p: None, periodic=(False, False), finer=NESTED)
    grid = BackgroundGrid((0.0, 0.0), 0.5, (32, 32), (False, False))
    ids = np.arange(grid.size)
    rows, x = find_nodes(solver, grid, ids), grid.positions()
    fine = ((x > 4.0) & (x < 12.0)).all(axis=1)
    np.testing.assert_array_equal(rows >= 0, fine)
    np.testing.assert_array_equal(solver.mesh.positions()[rows[fine]], x[fine])

"""Weights by which nodes move the ghosts."""

from __future__ import annotations

import numpy as np

from gimpmd_gimp.coupling.interface.weights import hats
from gimpmd_gimp.coupling.sites.weights import ghost_weights, touched
from gimpmd_schemas.grid.background import BackgroundGrid

GRID = BackgroundGrid((0.0, 0.0, 0.0), 2.0, (4, 4, 5), (False, False, False))
PERIOD = np.array([1.0, 3.0, 0.7])


def test_they_are_hats_averaged_over_a_period_along_every_axis() -> None:
    x = np.random.default_rng(2).uniform(3.0, 5.0, (4, 3))
    n = 24
    shifts = ((np.arange(n) + 0.5) / n - 0.5)[:, None] * np.eye(3)[:, None]  # (axis, n, 3)
    shifts = shifts * PERIOD
    grid_of_shifts = (
        shifts[0][:, None, None] + shifts[1][None, :, None] + shifts[2][None, None, :]
    ).reshape(-1, 3)
    found = ghost_weights(GRID, x, PERIOD).toarray()
    for row, place in zip(found, x, strict=True):
        mean = np.asarray(hats(GRID, place + grid_of_shifts).mean(axis=0)).ravel()
        np.testing.assert_allclose(row, mean, atol=2e-3)
    np.testing.assert_allclose(found.sum(axis=1), 1.0)
    np.testing.assert_allclose(found @ GRID.positions(), x)


def test_touched_nodes_have_more_than_round_off() -> None:
    weights = hats(GRID, np.array([[2.0, 4.0 + 1e-13, 5.0]]))
    assert touched(weights).sum() == 2

"""Weights by which nodes move the ghosts of scheme FS, and which nodes have any."""

from __future__ import annotations

import numpy as np

from gimpmd_gimp.coupling.interface.weights import Sparse, means
from gimpmd_schemas.arrays import Bools, Floats
from gimpmd_schemas.grid.background import BackgroundGrid

ROUNDING = 1e-12
"""Weights below this, over the largest, are round-off."""


def touched(*matrices: Sparse) -> Bools:
    """Tell which nodes, the columns, have a weight in one of the matrices; shape ``(nodes,)``."""
    found = np.zeros(matrices[0].shape[1], dtype=np.bool_)
    for matrix in matrices:
        size = abs(matrix).sum(axis=0)
        found |= size > ROUNDING * size.max(initial=0.0)
    return found


def ghost_weights(grid: BackgroundGrid, x: Floats, period: Floats) -> Sparse:
    """Hat functions averaged over one period of the crystal along every axis around each ghost.

    All ghosts have the same rule, whatever plane, edge or corner is near. Along a face the weights
    of a period's ghosts then add up evenly, and ghosts at the same place along an axis have the
    same function of it. Both are necessary for a uniform strain to be correctable.

    Parameters
    ----------
    x : ndarray, shape ``(n, d)``
        Lattice sites of the ghosts (length).
    period : ndarray, shape ``(d,)``
        Periods of the crystal along the axes (length).

    Returns
    -------
    sparse matrix, shape ``(n, grid.size)``
    """
    reach = 0.5 * np.asarray(period)
    return means(grid, x - reach, x + reach)

"""The nodal forces that a uniformly strained crystal leaves at the planes."""

from __future__ import annotations

import numpy as np

from gimpmd_gimp.coupling.interface.weights import Sparse, averages
from gimpmd_gimp.coupling.sites.pieces import ROUNDING, Pieces
from gimpmd_gimp.coupling.sites.shells import body_of
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.grid.background import BackgroundGrid

FLAT = 1e-14
"""Half-width, in cells, of a box that is a face."""


def residual(grid: BackgroundGrid, pieces: Pieces, force: Floats, stress: Floats) -> Floats:
    """Forces on nodes of the ghosts, and of the continuum beyond plane 2, under uniform strain.

    The continuum pulls with ``-sum_p V_p P grad S_ip`` beyond plane 2, and with the load ``P n`` on
    the faces of the body. Together this is the integral of ``N_i P n`` over plane 2, or
    ``+sum_p V_p P grad S_ip`` within plane 2 less the integral over the faces of the body there.

    Parameters
    ----------
    pieces : Pieces
        All within plane 2.
    force : ndarray, shape ``(grid.size, d)``
        Forces of the ghosts on nodes: minus the derivatives of the energy of the active sites,
        times the weights of the ghosts.
    stress : ndarray, shape ``(d, d)``
        First Piola-Kirchhoff stress of the crystal.

    Returns
    -------
    ndarray, shape ``(grid.size, d)``
    """
    within = pieces.take(pieces.active)
    pulled = np.stack([slope.T @ within.volume for slope in within.slopes(grid)], axis=1)
    for axis, ends in enumerate(body_of(grid)):
        for end, out in zip(ends, (-1.0, 1.0), strict=True):
            weights, area = _at_face(grid, within, axis, end)
            pulled[:, axis] -= out * (weights.T @ area)
    return np.asarray(force + pulled @ stress.T)


def _at_face(grid: BackgroundGrid, pieces: Pieces, axis: int, end: float) -> tuple[Sparse, Floats]:
    """Mean weights on the sides of pieces that lie on a face of the body, and their areas."""
    away = np.abs(pieces.x[:, axis] - end) - grid.cell * pieces.half[:, axis]
    beside = pieces.take(np.abs(away) < ROUNDING * grid.cell)
    x, half = beside.x.copy(), beside.half.copy()
    x[:, axis], half[:, axis] = end, FLAT
    return averages(grid, x, half), beside.volume / (2.0 * grid.cell * beside.half[:, axis])

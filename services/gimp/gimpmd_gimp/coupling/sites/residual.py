"""The nodal forces that a uniformly strained crystal leaves at the planes."""

from __future__ import annotations

import numpy as np

from gimpmd_gimp.coupling.sites.pieces import Pieces
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.grid.background import BackgroundGrid


def residual(grid: BackgroundGrid, pieces: Pieces, force: Floats, stress: Floats) -> Floats:
    """Forces on nodes of the ghosts, and of the continuum beyond plane 2, under uniform strain.

    The continuum pulls with ``-sum_p V_p P grad S_ip`` beyond plane 2. For a node whose hat lies in
    the grid this is ``+sum_p V_p P grad S_ip`` within plane 2, that is a closed integral of
    ``N_i P n``.

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
        It is meaningful for nodes whose hats lie in the grid.
    """
    within = pieces.take(pieces.active)
    pulled = np.stack([slope.T @ within.volume for slope in within.slopes(grid)], axis=1)
    return np.asarray(force + pulled @ stress.T)

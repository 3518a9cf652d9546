"""Displacement gradient of atoms from their nearest neighbours, which cracks do not blur."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from gimpmd_deploy.analysis.crack import Crack
from gimpmd_deploy.analysis.plane import FIRST_SHELL
from gimpmd_schemas.arrays import Floats, Ints

BROKEN = 1.3
"""Bonds longer than this, in reference lengths, do not count."""


@dataclass(frozen=True)
class Neighbours:
    """Pairs of nearest neighbours in the reference state; they serve all outputs of a run.

    Attributes
    ----------
    reference : ndarray, shape ``(n, d)``
    pairs : ndarray of int, shape ``(p, 2)``
    """

    reference: Floats
    pairs: Ints

    @classmethod
    def of(cls, reference: Floats, spacing: float, crack: Crack | None = None) -> Neighbours:
        """Find the neighbours of atoms whose nearest distance is ``spacing``.

        Pairs across the faces of a crack are left out, from its mouth to its initial tip, since
        its faces may stand so close to each other that no bond looks broken.
        """
        tree = cKDTree(reference)
        pairs = tree.query_pairs(FIRST_SHELL * spacing, output_type="ndarray").astype(np.int64)
        if crack is not None:
            above = crack.plane.height(reference) >= 0.0
            beside = crack.plane.position(reference) <= crack.length
            a, b = pairs.T
            pairs = pairs[(above[a] == above[b]) | ~(beside[a] & beside[b])]
        return cls(reference, pairs)


def displacement_gradient(neighbours: Neighbours, displacement: Floats) -> Floats:
    """Fit the displacement gradient of each atom to the bonds that are not broken.

    It is the least-squares solution of ``u_b - u_a = H (X_b - X_a)`` over the neighbours b of an
    atom a, and so exact for a uniform gradient, also at a free surface.

    Parameters
    ----------
    displacement : ndarray, shape ``(n, d)``

    Returns
    -------
    ndarray, shape ``(n, d, d)``
        ``H_ij = du_i / dX_j``; zero for atoms whose bonds do not span all directions.
    """
    X, (a, b) = neighbours.reference, neighbours.pairs.T
    n, d = X.shape
    bond, jump = X[b] - X[a], displacement[b] - displacement[a]
    length = np.linalg.norm(bond + jump, axis=1) / np.linalg.norm(bond, axis=1)
    whole = length <= BROKEN
    a, b, bond, jump = a[whole], b[whole], bond[whole], jump[whole]
    spread, moved = np.empty((n, d, d)), np.empty((n, d, d))
    for i in range(d):
        for j in range(d):
            # both atoms of a pair see the same product of two differences
            for out, products in (
                (spread, bond[:, i] * bond[:, j]),
                (moved, jump[:, i] * bond[:, j]),
            ):
                out[:, i, j] = np.bincount(a, products, n) + np.bincount(b, products, n)
    size = np.einsum("nkk->n", spread) / d
    poor = np.linalg.det(spread) <= 1e-3 * size**d
    spread[poor], moved[poor] = np.eye(d), 0.0
    return np.asarray(moved @ np.linalg.inv(spread))

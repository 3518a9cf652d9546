"""Equations near faces of the body that need not hold: balance under strains that load the face.

Under a strain with a traction on the face, a crystal with ``C12`` other than ``C44`` exerts a
couple where plane 2 meets the face, and so does any crystal whose layers end unevenly there. No
stress of the points can balance it, because stresses exert no couple. If the face is free there are
no such strains at it. So near the face only strains without traction on it must be in balance. The
others take *spare forces*: further unknowns, one for each of their equations, with a weight.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from scipy import sparse

from gimpmd_gimp.coupling.interface.weights import Sparse
from gimpmd_gimp.coupling.sites.shells import Face
from gimpmd_schemas.arrays import Bools, Floats

NEAR = 1.0
"""Nodes up to this many cells from a face are near it. With those on the face alone a couple is
left in some set-ups, 5e-4 of the traction in a hexagonal crystal."""

WEIGHT = 0.3
"""Weight of spare forces, times a cell to the power of ``d / 2 - 1``. A smaller
one leaves up to three times less under strains that load the face, but changes moduli up to five
times more (copper with cells of 2.5 lattice constants; 0.1 to 0.001)."""

ROUNDING = 1e-9


class Equations(Protocol):
    """Linear equations, by products with their matrix A."""

    def forward(self, x: Floats) -> Floats:
        """Product with A."""
        ...

    def backward(self, u: Floats) -> Floats:
        """Product with the transpose of A."""
        ...

    def normal(self) -> Sparse:
        """The matrix ``A A^T``."""
        ...


class Spared:
    """Equations of nodes, some of which are spared.

    Parameters
    ----------
    equations : Equations
        A row for each node, component and strain.
    turn : sparse matrix, shape ``(rows, rows)``
        Orthogonal.
    spare : ndarray of bool, shape ``(rows,)``
        Which of the turned rows are spared; see `near_faces`.
    weight : float
        The last unknowns times this are the spare forces.
    """

    def __init__(self, equations: Equations, turn: Sparse, spare: Bools, weight: float) -> None:
        self._equations, self._turn, self._weight = equations, turn, weight
        self._spare, self._rows = spare, np.flatnonzero(spare)

    def turned(self, b: Floats) -> Floats:
        """Right sides of the turned rows."""
        return np.asarray(self._turn @ b)

    def forward(self, x: Floats) -> Floats:
        """Product with the matrix."""
        x, extra = np.split(x, [len(x) - self._rows.size])
        force = self.turned(self._equations.forward(x))
        force[self._rows] += self._weight * extra
        return force

    def backward(self, u: Floats) -> Floats:
        """Transpose of `forward`."""
        return np.concatenate(
            [self._equations.backward(self._turn.T @ u), self._weight * u[self._rows]]
        )

    def normal(self) -> Sparse:
        """The normal matrix."""
        own = sparse.diags_array(self._weight**2 * self._spare)
        return (self._turn @ self._equations.normal() @ self._turn.T + own).tocsr()


def near_faces(
    places: Floats, faces: Sequence[Face], stress: Floats, cell: float
) -> tuple[Sparse, Bools]:
    """Turn the rows of each node such that those of strains that load faces near it come first.

    Parameters
    ----------
    places : ndarray, shape ``(n, d)``
        Places of the nodes.
    stress : ndarray, shape ``(c, d, d)``
        Derivative of the stress of the crystal in the strains (pressure).

    Returns
    -------
    turn : sparse matrix, shape ``(n d c, n d c)``
    spare : ndarray of bool, shape ``(n d c,)``
        The rows of these strains.
    """
    count, dim, _ = stress.shape
    near = np.zeros((len(places), dim), dtype=np.bool_)
    for face in faces:
        near[:, face.axis] |= np.abs(places[:, face.axis] - face.end) < (NEAR + ROUNDING) * cell
    turns, spares = np.empty((len(places), count, count)), np.empty((len(places), count), bool)
    for axes in np.unique(near, axis=0):
        tractions = stress[:, :, axes].reshape(count, -1).T
        _, size, directions = np.linalg.svd(tractions)
        here = (near == axes).all(axis=1)
        turns[here] = directions
        spares[here] = np.arange(count) < (size > ROUNDING * size.max(initial=0.0)).sum()
    blocks = np.repeat(turns, dim, axis=0)
    n = np.arange(len(blocks))
    turn = sparse.bsr_array((blocks, n, np.append(n, len(n))))
    return turn.tocsr(), np.repeat(spares, dim, axis=0).ravel()

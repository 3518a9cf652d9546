"""The gradient term: an energy of strains times second differences of displacements.

It balances what symmetric changes of the moduli cannot, in orientations of low symmetry. It does no
work under uniform strain, whose second differences vanish.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy import sparse

from gimpmd_gimp.coupling.interface.weights import Sparse
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.mechanics.elasticity import VOIGT


@dataclass(frozen=True, eq=False)
class GradientTerm:
    """``sum_i sum_km c_ikm . (u(i + e_k) - 2 u(i) + u(i - e_k)) eps_m(i)`` over nodes i.

    Attributes
    ----------
    nodes : ndarray of int64, shape ``(n,)``
        Ids of the nodes i.
    coefficients : ndarray, shape ``(n, d, c, d)``
        By axis k, strain m and component (energy per length).
    """

    nodes: Ints
    coefficients: Floats

    def take(self, chosen: Bools) -> GradientTerm:
        """The part of some of the nodes."""
        return GradientTerm(self.nodes[chosen], self.coefficients[chosen])

    def touched(self, grid: BackgroundGrid) -> Ints:
        """Ids of the nodes and their neighbours."""
        around = [side for pair in neighbours(grid, self.nodes) for side in pair]
        return np.unique(np.concatenate([self.nodes, *around]))

    def forces(self, grid: BackgroundGrid, nodes: Ints) -> Sparse:
        """Nodal forces at small displacements: a symmetric matrix, shape ``(n d, n d)``.

        Parameters
        ----------
        nodes : ndarray of int64, shape ``(n,)``
            Ids of the nodes of rows and columns, ascending, with all that are `touched`. Row
            ``d i + j`` is the force on node i along j.
        """
        count, dim, parts, _ = self.coefficients.shape
        bend, strain = self._differences(grid, nodes)
        blocks = self.coefficients.swapaxes(2, 3).reshape(count, dim * dim, parts)
        each = np.arange(count + 1)
        between = sparse.bsr_array((blocks, each[:-1], each), (count * dim * dim, count * parts))
        pull = bend.T @ between.tocsr() @ strain
        return -(pull + pull.T)

    def _differences(self, grid: BackgroundGrid, nodes: Ints) -> tuple[Sparse, Sparse]:
        """Second differences (by node, axis, component) and strains (by node, Voigt)."""
        dim, own, parts = grid.dim, np.arange(len(self.nodes)), len(VOIGT[grid.dim])
        middle = np.searchsorted(nodes, self.nodes)
        sides = [np.searchsorted(nodes, pair) for pair in neighbours(grid, self.nodes)]
        bends, strains = [], []
        for k, (before, after) in enumerate(sides):
            for j in range(dim):
                rows = (own * dim + k) * dim + j
                for at, value in ((before, 1.0), (middle, -2.0), (after, 1.0)):
                    bends.append((rows, at * dim + j, value))
        for (m, pair), turned in product(enumerate(VOIGT[dim]), (False, True)):
            k, j = pair[::-1] if turned else pair
            if turned and k == j:
                continue
            for at, sign in zip(sides[k], (-1.0, 1.0), strict=True):
                strains.append((own * parts + m, at * dim + j, 0.5 * sign / grid.cell))
        columns = len(nodes) * dim
        return (
            _sum_of_entries(bends, (len(own) * dim * dim, columns)),
            _sum_of_entries(strains, (len(own) * parts, columns)),
        )


def _sum_of_entries(entries: list[tuple[Ints, Ints, float]], shape: tuple[int, int]) -> Sparse:
    """Matrix of rows, columns and a value each; entries at the same place add up."""
    rows, columns = (np.concatenate([entry[k] for entry in entries]) for k in (0, 1))
    values = np.concatenate([np.full(len(entry[0]), entry[2]) for entry in entries])
    return sparse.csr_array((values, (rows, columns)), shape=shape)


def neighbours(grid: BackgroundGrid, nodes: Ints) -> list[tuple[Ints, Ints]]:
    """Ids of the nodes before and after nodes along each axis, on periodic axes the way round."""
    images = grid.images()
    return [(images[nodes - stride], images[nodes + stride]) for stride in strides(grid)]


def strides(grid: BackgroundGrid) -> list[int]:
    """Differences between the ids of neighbours along each axis."""
    return [int(np.prod(grid.shape[axis + 1 :])) for axis in range(grid.dim)]


def second_differences(grid: BackgroundGrid, nodes: Ints, T: Sparse) -> tuple[Ints, Sparse]:
    """Nodes with their neighbours along every axis among the nodes, and second differences there.

    Parameters
    ----------
    T : sparse matrix, shape ``(grid.size, grid.size)``
        See `slaves.constraints`.

    Returns
    -------
    centres : ndarray of int64
        Ids of these nodes. All of them and their neighbours are freedoms.
    bends : sparse matrix, shape ``(nodes, centres d)``
        Columns (1, -2, 1), for each centre and axis.
    """
    free = np.full(grid.size, -1, dtype=np.int64)
    own = nodes[T.diagonal()[nodes] != 0.0]
    free[own] = np.searchsorted(nodes, own)
    good = np.ones(len(own), dtype=np.bool_)
    for before, after in neighbours(grid, own):
        good &= (free[before] >= 0) & (free[after] >= 0)
    centres = own[good]
    before, after = (
        np.stack(side, axis=1) for side in zip(*neighbours(grid, centres), strict=True)
    )
    middle = np.broadcast_to(centres[:, None], before.shape)
    rows = free[np.concatenate([middle.ravel(), before.ravel(), after.ravel()])]
    columns = np.arange(middle.size)
    values = np.repeat([-2.0, 1.0, 1.0], len(columns))
    shape = (len(nodes), len(columns))
    return centres, sparse.csr_array((values, (rows, np.tile(columns, 3))), shape=shape)

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
        around = [self.nodes + sign * stride for stride in strides(grid) for sign in (-1, 1)]
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
        dim, own = grid.dim, np.arange(len(self.nodes))
        middle = np.searchsorted(nodes, self.nodes)
        bend = sparse.lil_array((len(own) * dim * dim, len(nodes) * dim))
        slope = []
        for k, stride in enumerate(strides(grid)):
            before, after = (np.searchsorted(nodes, self.nodes + s * stride) for s in (-1, 1))
            for j in range(dim):
                rows = (own * dim + k) * dim + j
                for at, value in ((before, 1.0), (middle, -2.0), (after, 1.0)):
                    bend[rows, at * dim + j] = value
            slope.append((before, after))
        strain = sparse.lil_array((len(own) * len(VOIGT[dim]), len(nodes) * dim))
        for (m, pair), turned in product(enumerate(VOIGT[dim]), (False, True)):
            k, j = pair[::-1] if turned else pair
            if turned and k == j:
                continue
            before, after = slope[k]
            strain[own * len(VOIGT[dim]) + m, after * dim + j] = 0.5 / grid.cell
            strain[own * len(VOIGT[dim]) + m, before * dim + j] = -0.5 / grid.cell
        return bend.tocsr(), strain.tocsr()


def strides(grid: BackgroundGrid) -> list[int]:
    """Differences between the ids of neighbours along each axis."""
    return [int(np.prod(grid.shape[axis + 1 :])) for axis in range(grid.dim)]


def second_differences(grid: BackgroundGrid, nodes: Ints, T: Sparse) -> tuple[Ints, Sparse]:
    """Nodes with two neighbours among the nodes along every axis, and second differences there.

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
    steps = np.array(strides(grid))
    good = np.ones(len(own), dtype=np.bool_)
    for step in steps:
        good &= (free[own - step] >= 0) & (free[own + step] >= 0)
    centres = own[good]
    columns = np.arange(len(centres) * grid.dim)
    at = (centres[:, None] + 0 * steps).ravel(), np.tile(steps, len(centres))
    rows = np.concatenate([free[at[0]], free[at[0] - at[1]], free[at[0] + at[1]]])
    values = np.repeat([-2.0, 1.0, 1.0], len(columns))
    shape = (len(nodes), len(columns))
    return centres, sparse.csr_array((values, (rows, np.tile(columns, 3))), shape=shape)

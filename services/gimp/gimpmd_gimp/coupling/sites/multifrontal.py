"""Cholesky factors of a sparse matrix whose rows belong to places in space.

Nested dissection by coordinates with dense fronts [1]_: the places are halved again and again at
the middle of their longest extent, and those that have neighbours across a cut are eliminated after
both halves. All arithmetic is that of LAPACK on dense matrices. In three dimensions this is several
times as fast as a general sparse solver, and takes less memory.

.. [1] I. S. Duff, J. K. Reid, ACM Trans. Math. Softw. 9, 302 (1983).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.linalg import cholesky, solve_triangular

from gimpmd_gimp.coupling.interface.weights import Sparse
from gimpmd_schemas.arrays import Floats, Ints

LEAF = 32
"""Number of places up to which they are not halved."""


@dataclass(frozen=True, eq=False)
class _Front:
    """Rows that are eliminated together, and the rows of later fronts that they meet."""

    own: Ints
    later: Ints
    L: Floats
    below: Floats


class Multifrontal:
    """Factors of a symmetric positive definite matrix.

    Parameters
    ----------
    A : sparse matrix, shape ``(n k, n k)``
        Rows ``p k`` to ``p k + k - 1`` belong to place p.
    x : ndarray, shape ``(n, d)``
        Places.
    """

    def __init__(self, A: Sparse, x: Floats) -> None:
        self._k = A.shape[0] // len(x)
        blocks = A.tocoo()
        self._graph = sparse.csr_array(
            (np.ones(blocks.nnz), (blocks.row // self._k, blocks.col // self._k)), (len(x), len(x))
        )
        self._sets: list[tuple[Ints, list[int]]] = []  # places and children, children first
        self._dissect(np.arange(len(x)), x)
        self._fronts = self._factor(A.tocsr())

    def solve(self, b: Floats) -> Floats:
        """Solve ``A x = b``, b of shape ``(n k,)``."""
        x = np.array(b, dtype=np.float64)
        for f in self._fronts:
            x[f.own] = solve_triangular(f.L, x[f.own], lower=True, check_finite=False)
            x[f.later] -= f.below @ x[f.own]
        for f in reversed(self._fronts):
            rest = x[f.own] - f.below.T @ x[f.later]
            x[f.own] = solve_triangular(f.L, rest, lower=True, trans="T", check_finite=False)
        return x

    def _dissect(self, places: Ints, x: Floats) -> int:
        """Note places in the order of elimination; returns the number of their last set."""
        children: list[int] = []
        if len(places) > LEAF:
            axis = int(np.argmax(np.ptp(x[places], axis=0)))
            along = x[places, axis]
            left = along < 0.5 * (along.min() + along.max())
            across = np.zeros(len(x))
            across[places[~left]] = 1.0
            cut = left & ((self._graph[places] @ across) > 0.0)
            if (left & ~cut).any():
                children = [self._dissect(places[left & ~cut], x), self._dissect(places[~left], x)]
                places = places[cut]
        self._sets.append((places, children))
        return len(self._sets) - 1

    def _factor(self, A: Sparse) -> list[_Front]:
        turn = np.empty(self._graph.shape[0], dtype=np.int64)
        for number, (places, _) in enumerate(self._sets):
            turn[places] = number
        met: list[Ints] = []
        updates: dict[int, Floats] = {}
        fronts: list[_Front] = []
        place = np.full(A.shape[0], -1, dtype=np.int64)  # of a row in the present front
        for number, (places, children) in enumerate(self._sets):
            touching = [self._graph[places].indices, *(met[child] for child in children)]
            later = np.unique(np.concatenate(touching))
            met.append(later[turn[later] > number])
            own, after = self._rows(places), self._rows(met[-1])
            rows = np.concatenate([own, after])
            place[rows] = np.arange(rows.size)
            front = np.zeros((rows.size, rows.size))
            entries = A[own].tocoo()
            inside = place[entries.col] >= 0
            front[place[entries.col[inside]], entries.row[inside]] = entries.data[inside]
            for child in children:
                at = place[fronts[child].later]
                front[np.ix_(at, at)] += updates.pop(child)
            place[rows] = -1
            n = own.size
            L = cholesky(front[:n, :n], lower=True, check_finite=False)
            below = solve_triangular(L, front[n:, :n].T, lower=True, check_finite=False).T
            updates[number] = front[n:, n:] - below @ below.T
            fronts.append(_Front(own, after, L, below))
        return fronts

    def _rows(self, places: Ints) -> Ints:
        return np.asarray((places[:, None] * self._k + np.arange(self._k)).ravel())

"""Cholesky factors of a sparse matrix whose rows belong to places in space.

Nested dissection by coordinates with dense fronts [1]_: the places are halved again and again at
the middle of their longest extent, and those that have neighbours across a cut are eliminated after
both halves. All arithmetic is that of LAPACK on dense matrices. In three dimensions this is several
times as fast as a general sparse solver, and takes less memory.

.. [1] I. S. Duff, J. K. Reid, ACM Trans. Math. Softw. 9, 302 (1983).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.linalg import cholesky, solve_triangular

from gimpmd_gimp.coupling.interface.weights import Sparse
from gimpmd_schemas.arrays import Floats, Ints

LEAF = 32
"""Number of places up to which they are not halved."""


@dataclass(frozen=True, eq=False)
class Turn:
    """Places that are eliminated together.

    Attributes
    ----------
    own, later : ndarray of int64
        These places, and those of later turns that they meet.
    children : tuple of int
        Numbers of the turns whose updates come to this one.
    """

    own: Ints
    later: Ints
    children: tuple[int, ...]


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
    A : sparse matrix in rows, shape ``(n k, n k)``
        Rows ``p k`` to ``p k + k - 1`` belong to place p.
    x : ndarray, shape ``(n, d)``
        Places.
    """

    def __init__(self, A: Sparse, x: Floats) -> None:
        k = A.shape[0] // len(x)
        self._fronts = _factor(A, dissect(_graph(A, k), x), k)

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


def _graph(A: Sparse, k: int) -> Sparse:
    """Which places have entries of a matrix in common."""
    # the k rows of a place follow each other, so together they are one row of the graph
    parts = np.ones(A.nnz, dtype=np.bool_), A.indices // k, A.indptr[::k].copy()
    graph = sparse.csr_array(parts, shape=(A.shape[0] // k,) * 2)
    graph.sum_duplicates()
    return graph


def dissect(graph: Sparse, x: Floats) -> list[Turn]:
    """Put places in the order of elimination.

    Parameters
    ----------
    graph : sparse matrix in rows, shape ``(n, n)``
        Its entries tell which places are bound to each other.
    x : ndarray, shape ``(n, d)``
        Places.
    """
    sets: list[tuple[Ints, tuple[int, ...]]] = []  # children first
    _halve(graph, x, np.arange(len(x)), sets)
    turn = np.empty(len(x), dtype=np.int64)
    for number, (places, _) in enumerate(sets):
        turn[places] = number
    found: list[Turn] = []
    for number, (places, children) in enumerate(sets):
        touching = [graph[places].indices, *(found[child].later for child in children)]
        later = np.unique(np.concatenate(touching))
        found.append(Turn(places, later[turn[later] > number], children))
    return found


def _halve(graph: Sparse, x: Floats, places: Ints, sets: list[tuple[Ints, tuple[int, ...]]]) -> int:
    """Note places in the order of elimination; returns the number of their last set."""
    children: tuple[int, ...] = ()
    if len(places) > LEAF:
        axis = int(np.argmax(np.ptp(x[places], axis=0)))
        along = x[places, axis]
        left = along < 0.5 * (along.min() + along.max())
        across = np.zeros(len(x))
        across[places[~left]] = 1.0
        cut = left & ((graph[places] @ across) > 0.0)
        if (left & ~cut).any():
            halves = places[left & ~cut], places[~left]
            children = tuple(_halve(graph, x, half, sets) for half in halves)
            places = places[cut]
    sets.append((places, children))
    return len(sets) - 1


def _factor(A: Sparse, turns: Sequence[Turn], k: int) -> list[_Front]:
    updates: dict[int, Floats] = {}
    fronts: list[_Front] = []
    for number, turn in enumerate(turns):
        own, later = _rows(turn.own, k), _rows(turn.later, k)
        come = ((fronts[child].later, updates.pop(child)) for child in turn.children)
        # no name for the front, so that it goes before the next one is made
        L, below, updates[number] = _eliminate(_assemble(A, own, later, come), own.size)
        fronts.append(_Front(own, later, L, below))
    return fronts


def _assemble(A: Sparse, own: Ints, later: Ints, updates: Iterable[tuple[Ints, Floats]]) -> Floats:
    """The rows and columns ``own`` of A in a dense matrix of all rows, and the updates."""
    rows = np.concatenate([own, later])
    place = np.full(A.shape[0], -1, dtype=np.int64)  # of a row in the front
    place[rows] = np.arange(rows.size)
    front = np.zeros((rows.size, rows.size))
    entries = A[own].tocoo()
    inside = place[entries.col] >= 0
    front[place[entries.col[inside]], entries.row[inside]] = entries.data[inside]
    for of_update, update in updates:
        at = place[of_update]
        front[np.ix_(at, at)] += update
    return front


def _eliminate(front: Floats, n: int) -> tuple[Floats, Floats, Floats]:
    """Eliminate the first n rows of a front; returns L, what is below it, and the update."""
    L = cholesky(front[:n, :n], lower=True, check_finite=False)
    below = solve_triangular(L, front[n:, :n].T, lower=True, check_finite=False).T
    return L, below, front[n:, n:] - below @ below.T


def _rows(places: Ints, k: int) -> Ints:
    return np.asarray((places[:, None] * k + np.arange(k)).ravel())


def memory(turns: Sequence[Turn], k: int) -> tuple[int, int]:
    """Bytes of the factors of a matrix, and the most that are held while they are made.

    Parameters
    ----------
    turns : sequence of Turn
        See `dissect`.
    k : int
        Rows of the matrix for each place.
    """
    held = waiting = most = 0
    for turn in turns:
        n, m = k * len(turn.own), k * len(turn.later)
        come = [(k * len(turns[child].later)) ** 2 for child in turn.children]
        # the front while an update is added to it, with a copy of that part
        most = max(most, held + waiting + (n + m) ** 2 + max(come, default=0))
        held += n * n + n * m
        waiting -= sum(come)
        # the front, and below @ below.T and its difference to a part of the front
        most = max(most, held + waiting + (n + m) ** 2 + 2 * m * m)
        waiting += m * m
    size = np.dtype(np.float64).itemsize
    return size * held, size * most

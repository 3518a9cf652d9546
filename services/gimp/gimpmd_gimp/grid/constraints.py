"""Nodes whose value follows from other nodes: hanging nodes, covered nodes, periodic images.

A constrained node takes the value ``q_c = sum_j w_cj q_j`` of its parents j. Sums collected on a
constrained node go to its parents with the transposed weights, so mass and momentum are exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimpmd_gimp.sweeps.kernels import sweep
from gimpmd_gimp.sweeps.simd import at, deposit, load, store, zero
from gimpmd_schemas.arrays import Bools, Floats, Ints


@dataclass(frozen=True)
class Constraints:
    """Constrained nodes and their parents, in compressed rows.

    Attributes
    ----------
    node : ndarray of int64, shape ``(n,)``
        Constrained nodes.
    start : ndarray of int64, shape ``(n + 1,)``
        Where the parents of each constrained node begin in the arrays below.
    parent : ndarray of int64, shape ``(m,)``
        Parents. A parent is never constrained itself.
    weight : ndarray, shape ``(m,)``
        Weight of each parent.
    """

    node: Ints
    start: Ints
    parent: Ints
    weight: Floats

    def restrict(self, field: Floats) -> None:
        """Move sums ``(size, k)`` from constrained nodes to their parents, in place."""
        if self.node.size:
            axes = (0,) * field.shape[1]
            _restrict(axes, self.node, self.start, self.parent, self.weight, field)

    def prolong(self, field: Floats) -> None:
        """Interpolate a field ``(size, k)`` from parents to constrained nodes, in place."""
        if self.node.size:
            axes = (0,) * field.shape[1]
            _prolong(axes, self.node, self.start, self.parent, self.weight, field)

    def among(self, chosen: Bools) -> Constraints:
        """Return the constraints of the nodes that a mask ``(size,)`` selects."""
        rows = np.flatnonzero(chosen[self.node])
        entries = np.concatenate(
            [np.empty(0, np.int64), *(np.arange(self.start[r], self.start[r + 1]) for r in rows)]
        )
        lengths = np.diff(self.start)[rows]
        start = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
        return Constraints(self.node[rows], start, self.parent[entries], self.weight[entries])


def make_constraints(node: Ints, parent: Ints, weight: Floats) -> Constraints:
    """Sort triples (constrained node, parent, weight), in any order, into rows."""
    order = np.argsort(node, kind="stable")
    nodes, start = np.unique(node[order], return_index=True)
    start = np.append(start, node.size).astype(np.int64)
    return Constraints(nodes.astype(np.int64), start, parent[order].astype(np.int64), weight[order])


@sweep
def _restrict(
    axes: tuple[int, ...], node: Ints, start: Ints, parent: Ints, weight: Floats, field: Floats
) -> None:
    for n in range(node.size):
        value = load(axes, field, at(node, n))
        empty = True
        for k in range(len(axes)):
            empty &= value[k] == 0.0
        if not empty:  # most constrained nodes have no sums
            for j in range(at(start, n), at(start, n + 1)):
                deposit(field, at(parent, j), at(weight, j) * value)
            store(field, at(node, n), zero(axes))


@sweep
def _prolong(
    axes: tuple[int, ...], node: Ints, start: Ints, parent: Ints, weight: Floats, field: Floats
) -> None:
    for n in range(node.size):
        value = zero(axes)
        for j in range(at(start, n), at(start, n + 1)):
            value = value + at(weight, j) * load(axes, field, at(parent, j))
        store(field, at(node, n), value)

"""Nodes whose value follows from other nodes: hanging nodes, covered nodes, periodic images.

A constrained node takes the value ``q_c = sum_j w_cj q_j`` of its parents j. Sums collected on a
constrained node go to its parents with the transposed weights, so mass and momentum are exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimpmd_gimp.sweeps.kernels import sweep
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
            _restrict(self.node, self.start, self.parent, self.weight, field)

    def prolong(self, field: Floats) -> None:
        """Interpolate a field ``(size, k)`` from parents to constrained nodes, in place."""
        if self.node.size:
            _prolong(self.node, self.start, self.parent, self.weight, field)

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
def _restrict(node: Ints, start: Ints, parent: Ints, weight: Floats, field: Floats) -> None:
    for n in range(node.size):
        for k in range(field.shape[1]):
            value = field[node[n], k]
            if value != 0.0:
                for j in range(start[n], start[n + 1]):
                    field[parent[j], k] += weight[j] * value
                field[node[n], k] = 0.0


@sweep
def _prolong(node: Ints, start: Ints, parent: Ints, weight: Floats, field: Floats) -> None:
    for n in range(node.size):
        for k in range(field.shape[1]):
            value = 0.0
            for j in range(start[n], start[n + 1]):
                value += weight[j] * field[parent[j], k]
            field[node[n], k] = value

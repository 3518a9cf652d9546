"""Nodes that take their value from others: hanging nodes, nodes under a finer level, images.

``values[slave] = sum_j weight_j values[master_j]``; sums go back by the transpose, so mass and
momentum are exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimpmd_gimp.sweeps.kernels import sweep
from gimpmd_schemas.arrays import Bools, Floats, Ints


@dataclass(frozen=True)
class Slaves:
    """Slaves and their masters, row by row.

    Attributes
    ----------
    node : ndarray of int64, shape ``(n,)``
    start : ndarray of int64, shape ``(n + 1,)``
        Where each slave's masters begin in the arrays below.
    master : ndarray of int64, shape ``(m,)``
        Never slaves themselves.
    weight : ndarray, shape ``(m,)``
    """

    node: Ints
    start: Ints
    master: Ints
    weight: Floats

    def restrict(self, field: Floats) -> None:
        """Hand sums on slaves ``(size, k)`` over to their masters, in place (transpose)."""
        if self.node.size:
            _restrict(self.node, self.start, self.master, self.weight, field)

    def prolong(self, field: Floats) -> None:
        """Give slaves the interpolated values of their masters, in place."""
        if self.node.size:
            _prolong(self.node, self.start, self.master, self.weight, field)

    def among(self, chosen: Bools) -> Slaves:
        """Those slaves that a mask over all nodes chooses."""
        rows = np.flatnonzero(chosen[self.node])
        entries = np.concatenate(
            [np.empty(0, np.int64), *(np.arange(self.start[r], self.start[r + 1]) for r in rows)]
        )
        lengths = np.diff(self.start)[rows]
        start = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
        return Slaves(self.node[rows], start, self.master[entries], self.weight[entries])


def make_slaves(slave: Ints, master: Ints, weight: Floats) -> Slaves:
    """Sort single dependences, in any order, into rows."""
    order = np.argsort(slave, kind="stable")
    node, start = np.unique(slave[order], return_index=True)
    start = np.append(start, slave.size).astype(np.int64)
    return Slaves(node.astype(np.int64), start, master[order].astype(np.int64), weight[order])


@sweep
def _restrict(node: Ints, start: Ints, master: Ints, weight: Floats, field: Floats) -> None:
    for n in range(node.size):
        for k in range(field.shape[1]):
            value = field[node[n], k]
            if value != 0.0:
                for j in range(start[n], start[n + 1]):
                    field[master[j], k] += weight[j] * value
                field[node[n], k] = 0.0


@sweep
def _prolong(node: Ints, start: Ints, master: Ints, weight: Floats, field: Floats) -> None:
    for n in range(node.size):
        for k in range(field.shape[1]):
            value = 0.0
            for j in range(start[n], start[n + 1]):
                value += weight[j] * field[master[j], k]
            field[node[n], k] = value

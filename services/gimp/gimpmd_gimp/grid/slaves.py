"""Nodes of the finest level that follow other nodes, such as those with next to no continuum.

They are constrained as hanging nodes are: sums on a slave go to the nodes that it follows, and its
value is interpolated from theirs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimpmd_schemas.arrays import Floats, Ints


@dataclass(frozen=True)
class Slaves:
    """Slaves and the nodes that they follow, in compressed rows, on the lattice of the level.

    Attributes
    ----------
    node : ndarray of int64, shape ``(n, d)``
        Slaves, inside the finest level and away from its rim; along periodic axes in the domain.
    start : ndarray of int64, shape ``(n + 1,)``
        Where the nodes that each slave follows begin in the arrays below.
    master : ndarray of int64, shape ``(m, d)``
        These nodes; none of them is a slave.
    weight : ndarray, shape ``(m,)``
    """

    node: Ints
    start: Ints
    master: Ints
    weight: Floats


def redirected(
    slaves: Slaves, top: int, row: Ints, level: Ints, coords: Ints, weight: Floats
) -> tuple[Ints, Ints, Ints, Floats]:
    """Replace slaves among the parents of nodes by the nodes that they follow.

    Parameters
    ----------
    top : int
        The finest level.
    row, level, coords, weight : ndarray
        See `Hierarchy.parents`.

    Returns
    -------
    tuple
        As the parameters.
    """
    number = {tuple(node): k for k, node in enumerate(slaves.node.tolist())}
    slave = np.full(row.size, -1, dtype=np.int64)
    low, high = slaves.node.min(axis=0), slaves.node.max(axis=0)
    near = np.flatnonzero((level == top) & ((coords >= low) & (coords <= high)).all(axis=1))
    slave[near] = [number.get(tuple(c), -1) for c in coords[near].tolist()]
    kept, moved = slave < 0, np.flatnonzero(slave >= 0)
    counts = np.diff(slaves.start)[slave[moved]]
    entries = np.concatenate(
        [
            np.empty(0, np.int64),
            *(np.arange(slaves.start[s], slaves.start[s + 1]) for s in slave[moved]),
        ]
    )
    row = np.concatenate([row[kept], np.repeat(row[moved], counts)])
    level = np.concatenate([level[kept], np.full(entries.size, top)])
    coords = np.concatenate([coords[kept], slaves.master[entries]])
    weight = np.concatenate(
        [weight[kept], np.repeat(weight[moved], counts) * slaves.weight[entries]]
    )
    order = np.argsort(row, kind="stable")
    return row[order], level[order], coords[order], weight[order]

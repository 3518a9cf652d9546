"""Which points and nodes take part when only finer levels step (force-splitting sub-steps).

Between two kicks of a coarse level its points keep their velocity. Points near a finer level are
the exception: kicks of the finer level change nodes that both levels share. A kick of the finer
level reaches points up to one stencil (a cell and a quarter) outside that level. The momentum of
these points reaches nodes within two cells, and the velocity of these nodes reaches points within
three and a quarter cells. Points that close move with the time step of the finer level. Every
nodal sum that such a point reads must include all points that touch the node.

The dispersion correction spreads kicks and velocities by one more node each. It needs points that
stay inside their cell. A kick then reaches nodes within one cell, corrected kicks reach two cells,
their points and the momentum of these three cells, and corrected velocities four cells.
"""

from __future__ import annotations

import numpy as np

from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_schemas.arrays import Bools, Floats, Int32s

POINTS_MOVED = 3.5
"""Distance from a finer level, in cells of the next coarser one, within which points move with the
finer time step. The nodes that they touch lie within ``NODES_COUPLED``."""

NODES_COUPLED = 4.0
"""Distance, in the same cells, within which nodes influence the sub-steps of a finer level."""

POINT_MARGIN = 1.75
"""Distance beyond ``NODES_COUPLED``, in cells of the level of a point, within which the point
contributes to the sums of these nodes. A point touches nodes within one and a half cells."""

NODE_MARGIN = 3.25
"""Distance beyond ``NODES_COUPLED``, in cells of the level of a node, within which a node gets
contributions of these points. Nodes lie at integer distances, so rounding cannot move a node
across the limit."""

NODES_COMPLETE = 4.5
"""Distance, in cells of the next coarser level, within which nodal sums are complete."""

NODES_KICKED = 2.5
"""Distance, in cells of the next coarser level, within which corrected kicks change nodes."""


def rate_of(level_of: Int32s, x: Floats, hierarchy: Hierarchy, corrected: bool = False) -> Int32s:
    """Level with whose time step each point moves, shape ``(n,)``.

    Parameters
    ----------
    level_of : ndarray of int32, shape ``(n,)``
        Level of each point.
    x : ndarray, shape ``(n, d)``
        Positions on the grid.
    corrected : bool
        Whether the dispersion correction is in use.
    """
    own = hierarchy.cell / 2.0**level_of
    rate = level_of.copy()
    for level in range(1, hierarchy.top + 1):
        edge = hierarchy.edge(level - 1)
        limit = NODES_COUPLED * edge + own if corrected else POINTS_MOVED * edge
        near = hierarchy.distance(level, x) < limit
        rate[near & (level_of < level)] = level
    return rate


def finest_summed(level_of: Int32s, x: Floats, hierarchy: Hierarchy) -> Int32s:
    """Finest level in whose sub-steps each point contributes to nodal sums, shape ``(n,)``."""
    finest = level_of.copy()
    own = hierarchy.cell / 2.0**level_of
    for level in range(1, hierarchy.top + 1):
        limit = NODES_COUPLED * hierarchy.edge(level - 1) + POINT_MARGIN * own
        near = hierarchy.distance(level, x) < limit
        finest[near & (level_of < level)] = level
    return finest


def summed_nodes(mesh: Mesh, level: int) -> Bools:
    """Nodes that get sums when ``level`` is the coarsest that steps, constrained ones included."""
    if level == 0:
        return np.ones(mesh.size, dtype=np.bool_)
    h = mesh.hierarchy
    limit = NODES_COUPLED * h.edge(level - 1) + NODE_MARGIN * h.cell / 2.0**mesh.level
    return (mesh.level >= level) | (h.distance(level, mesh.positions()) <= limit)


def complete_nodes(mesh: Mesh, level: int) -> Bools:
    """Nodes whose sums are complete when ``level`` is the coarsest that steps."""
    if level == 0:
        return np.ones(mesh.size, dtype=np.bool_)
    h = mesh.hierarchy
    away = h.distance(level, mesh.positions())
    return (mesh.level >= level) | (away <= NODES_COMPLETE * h.edge(level - 1))


def kicked_nodes(mesh: Mesh, level: int) -> Bools:
    """Nodes that corrected kicks reach when ``level`` is the coarsest that steps."""
    if level == 0:
        return np.ones(mesh.size, dtype=np.bool_)
    h = mesh.hierarchy
    return np.asarray(h.distance(level, mesh.positions()) < NODES_KICKED * h.edge(level - 1))


def coarsest(step: int, top: int) -> int:
    """The coarsest level that takes part in step number ``step`` of the finest level.

    Level l steps once in ``2^(top - l)`` steps of the finest level.
    """
    level = top
    while level > 0 and step % 2 ** (top - level + 1) == 0:
        level -= 1
    return level

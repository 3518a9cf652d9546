"""Which points and nodes take part when only finer levels step (force-splitting sub-steps).

Between two kicks of a coarse level its points keep their velocity, except near a finer level,
whose kicks reach them through the nodes that both touch. A kick reaches points a stencil's reach
(a cell and a quarter) outside the finer level, their momentum the nodes within two cells, and
these nodes' velocities the points within three and a quarter: points so near move by the finer
level's steps. What these points see must be summed over all points that touch the same nodes.

The dispersion correction carries kicks, and velocities, on by a node each. There points lie within
a cell, so a kick reaches nodes within one cell, corrected within two, their points within three,
momentum too, and corrected velocities nodes within four.
"""

from __future__ import annotations

import numpy as np

from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.points.material_points import Flags
from gimpmd_schemas.arrays import Bools, Floats

MOVED = 3.5
"""Distance from a finer level, in cells of the next coarser one, within which points move by the
finer step; the nodes that they touch lie within ``REACH``."""

REACH = 4.0
"""Distance within which nodes have a say in a finer level's sub-steps, in the same cells."""

SUMMED, TOUCHED = 1.75, 3.25
"""Beyond these, in cells of a point's or node's own level: how far points count in the
sums of those nodes (which they touch within one and a half), and nodes see points that count.
Nodes lie at whole numbers, so that rounding cannot move one across."""

WHOLE = 4.5
"""Distance, in cells of the next coarser level, within which sums on nodes are whole."""


KICKED = 2.5
"""Distance from a finer level, in cells of the next coarser one, within which nodes change by its
corrected kicks."""


def rate_of(level_of: Flags, x: Floats, hierarchy: Hierarchy, corrected: bool = False) -> Flags:
    """Level whose time step each point moves by, shape ``(n,)``, by level and place on the grid."""
    own = hierarchy.cell / 2.0**level_of
    rate = level_of.copy()
    for level in range(1, hierarchy.top + 1):
        edge = hierarchy.edge(level - 1)
        near = hierarchy.distance(level, x) < (REACH * edge + own if corrected else MOVED * edge)
        rate[near & (level_of < level)] = level
    return rate


def reach_of(level_of: Flags, x: Floats, hierarchy: Hierarchy) -> Flags:
    """Finest level for which, as the coarsest that steps, a point counts in sums, ``(n,)``."""
    reach = level_of.copy()
    own = hierarchy.cell / 2.0**level_of
    for level in range(1, hierarchy.top + 1):
        limit = REACH * hierarchy.edge(level - 1) + SUMMED * own
        near = hierarchy.distance(level, x) < limit
        reach[near & (level_of < level)] = level
    return reach


def touched(mesh: Mesh, level: int) -> Bools:
    """Nodes, slaves included, that get sums when ``level`` is the coarsest that steps."""
    if level == 0:
        return np.ones(mesh.size, dtype=np.bool_)
    h = mesh.hierarchy
    limit = REACH * h.edge(level - 1) + TOUCHED * h.cell / 2.0**mesh.level
    return (mesh.level >= level) | (h.distance(level, mesh.positions()) <= limit)


def whole(mesh: Mesh, level: int) -> Bools:
    """Nodes whose sums are whole when ``level`` is the coarsest that steps."""
    if level == 0:
        return np.ones(mesh.size, dtype=np.bool_)
    h = mesh.hierarchy
    away = h.distance(level, mesh.positions())
    return (mesh.level >= level) | (away <= WHOLE * h.edge(level - 1))


def kicked(mesh: Mesh, level: int) -> Bools:
    """Nodes that corrected kicks reach when ``level`` is the coarsest that steps."""
    if level == 0:
        return np.ones(mesh.size, dtype=np.bool_)
    h = mesh.hierarchy
    return np.asarray(h.distance(level, mesh.positions()) < KICKED * h.edge(level - 1))


def steppers(step: int, top: int) -> int:
    """The coarsest level that steps at fine step number ``step``: level l does every 2^(top-l)."""
    level = top
    while level > 0 and step % 2 ** (top - level + 1) == 0:
        level -= 1
    return level

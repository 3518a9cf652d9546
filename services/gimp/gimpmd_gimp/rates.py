"""Which points and nodes take part when only finer levels step (force-splitting sub-steps).

Between two kicks of a coarse level its points keep their velocity, except near a finer level,
whose kicks reach them through the nodes that both touch. A kick reaches points a stencil's reach
(a cell and a quarter) outside the finer level, their momentum the nodes within two cells, and
these nodes' velocities the points within three and a quarter: points so near move by the finer
level's steps. What these points see must be summed over all points that touch the same nodes.
"""

from __future__ import annotations

import numpy as np

from gimpmd_gimp.hierarchy import Hierarchy
from gimpmd_gimp.mesh import Mesh
from gimpmd_gimp.points import Flags, MaterialPoints
from gimpmd_schemas.grid import Bools

MOVED, SUMMED = 3.5, 5.75
"""Distances from a finer level, in coarser cells, within which points move by the finer step, and
within which they count in its nodal sums."""

WHOLE, TOUCHED = 4.5, 7.25
"""Distances within which nodes see no point that does not count, and within which they see any
that does. Nodes lie at whole numbers, so that rounding cannot move one across."""


def rate_of(points: MaterialPoints, hierarchy: Hierarchy) -> Flags:
    """Level whose time step each point moves by, shape ``(n,)``."""
    rate = points.level.copy()
    for level in range(hierarchy.top):
        own = np.flatnonzero(points.level == level)
        away = hierarchy.distance(level + 1, points.x[own])
        rate[own[away < MOVED * hierarchy.edge(level)]] = level + 1
    return rate


def reach_of(points: MaterialPoints, hierarchy: Hierarchy) -> Flags:
    """Finest level for which, as the coarsest that steps, a point counts in sums, ``(n,)``."""
    reach = points.level.copy()
    for level in range(hierarchy.top):
        own = np.flatnonzero(points.level == level)
        away = hierarchy.distance(level + 1, points.x[own])
        reach[own[away < SUMMED * hierarchy.edge(level)]] = level + 1
    return reach


def touched(mesh: Mesh, level: int) -> Bools:
    """Nodes, slaves included, that get sums when ``level`` is the coarsest that steps."""
    return _within(mesh, level, TOUCHED)


def whole(mesh: Mesh, level: int) -> Bools:
    """Nodes whose sums are whole when ``level`` is the coarsest that steps."""
    return _within(mesh, level, WHOLE)


def _within(mesh: Mesh, level: int, cells: float) -> Bools:
    """Nodes of a level and finer ones, and of the next coarser one within so many of its cells."""
    chosen = mesh.level >= level
    if level > 0:
        h = mesh.hierarchy
        rim = np.flatnonzero(mesh.level == level - 1)
        away = h.distance(level, mesh.positions()[rim])
        chosen[rim[away <= cells * h.edge(level - 1)]] = True
    return chosen


def steppers(step: int, top: int) -> int:
    """The coarsest level that steps at fine step number ``step``: level l does every 2^(top-l)."""
    level = top
    while level > 0 and step % 2 ** (top - level + 1) == 0:
        level -= 1
    return level

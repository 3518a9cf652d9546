"""Nodes of the shared grid whose velocities the atoms need, by the schemes with planes."""

from __future__ import annotations

import numpy as np

from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.grid.planes import deepest

FIT_CELLS = (1.0, 4.0)
"""Distances (cells) from the planes between which the absorber sees nodes: three columns. The node
next to a plane is none of them: it moves ghosts, or follows other nodes."""

STRICT = 1e-9
"""Share of a cell that is rounding: a node at one of these distances is not seen by any program."""


def interface_nodes(plan: Plan) -> Ints:
    """Ids, ascending, of the nodes of ghosts, and of those that the absorber sees.

    The continuum offers the velocities of these nodes, and takes forces on them.
    """
    grid = plan.background_grid()
    ghosts = [interface.ghost_nodes(grid) for interface in plan.coupled.interfaces]
    return np.unique(np.concatenate([*ghosts, fit_nodes(plan)]))


def fit_nodes(plan: Plan) -> Ints:
    """Ids, ascending, of the canonical nodes that the absorber sees; empty without absorber.

    Only nodes of the finest level that are freedoms count: those strictly inside its boxes, or on
    a face of the domain.
    """
    grid = plan.background_grid()
    if plan.coupled.absorber is None:
        return np.empty(0, dtype=np.int64)
    x = grid.positions()
    depth = deepest(plan.coupled.interfaces, x)
    near, far = FIT_CELLS[0] + STRICT, FIT_CELLS[1] - STRICT
    seen = grid.canonical() & (-depth > near * grid.cell) & (-depth < far * grid.cell)
    return np.flatnonzero(seen & _in_finest(plan, x)).astype(np.int64)


def _in_finest(plan: Plan, x: Floats) -> Bools:
    """Which nodes at ``x (n, d)`` lie inside the domain and the boxes of the finest level."""
    margin = 0.5 * plan.finest_cell
    inside = np.zeros(len(x), dtype=np.bool_)
    for box in plan.level_boxes[-1]:
        held = np.ones(len(x), dtype=np.bool_)
        for axis, (ends, limits) in enumerate(zip(box, plan.domain.box, strict=True)):
            for end, limit, sign in zip(ends, limits, (1.0, -1.0), strict=True):
                at_face = abs(end - limit) < margin
                held &= sign * (x[:, axis] - end) > (-margin if at_face else margin)
        inside |= held
    return inside

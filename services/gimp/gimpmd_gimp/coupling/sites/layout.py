"""The interface of a plan: shells, pieces of the continuum, and the nodes that follow others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimpmd_gimp.coupling.interface.weights import Sparse
from gimpmd_gimp.coupling.sites.pieces import Pieces, cut_cells
from gimpmd_gimp.coupling.sites.shells import Shells
from gimpmd_gimp.coupling.sites.slaves import constraints, find_slaves
from gimpmd_gimp.coupling.sites.touched import touched
from gimpmd_gimp.grid.slaves import Slaves
from gimpmd_schemas.arrays import Ints
from gimpmd_schemas.case.form import Sites
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.grid.background import PAD, BackgroundGrid

AROUND = 5.0
"""Cells around the second planes that have pieces: the corrected ones lie within 1.75 cells, and
slaves follow cells within four."""


@dataclass(frozen=True, eq=False)
class Layout:
    """The interface of all MD regions.

    Attributes
    ----------
    grid : BackgroundGrid
    shells : Shells
    pieces : Pieces
        Around the regions.
    T : sparse matrix, shape ``(grid.size, grid.size)``
        Gives all nodes their values from those that are no slaves; see `slaves.constraints`.
    """

    grid: BackgroundGrid
    shells: Shells
    pieces: Pieces
    T: Sparse


def measured(plan: Plan) -> Sites:
    """What LAMMPS has measured at the planes.

    Raises
    ------
    ValueError
        The plan is not one of the sites scheme.
    """
    sites = plan.coupled.sites
    if sites is None:
        raise ValueError("the crystal at the planes has not been measured yet")
    return sites


def lay_out(plan: Plan) -> Layout:
    """Find shells, pieces and slaves of a plan; the same on all ranks.

    Raises
    ------
    BackendError
        A node has almost no continuum, and no cell of the continuum is near it.
    """
    grid, interfaces = plan.background_grid(), plan.coupled.interfaces
    shells = Shells(
        free=tuple(interface.planes for interface in interfaces),
        active=tuple(interface.second or () for interface in interfaces),
    )
    pieces = cut_cells(grid, shells, AROUND)
    covered = touched(*pieces.take(~pieces.free).slopes(grid))
    moving = np.zeros(grid.size, dtype=np.bool_)
    moving[list(measured(plan).nodes)] = True
    slaves = find_slaves(grid, shells, covered | moving)
    return Layout(grid, shells, pieces, constraints(grid, slaves, covered))


def slaves_of(layout: Layout) -> Slaves | None:
    """The slaves as the mesh takes them; None if there are none."""
    T, grid = layout.T.tocsr(), layout.grid
    nodes = np.flatnonzero(T.diagonal() == 0.0).astype(np.int64)
    if not nodes.size:
        return None
    rows = T[nodes]

    def coords(ids: Ints) -> Ints:
        return np.stack(np.unravel_index(ids, grid.shape), axis=1).astype(np.int64) - PAD

    return Slaves(
        node=coords(nodes),
        start=rows.indptr.astype(np.int64),
        master=coords(rows.indices.astype(np.int64)),
        weight=rows.data.copy(),
    )

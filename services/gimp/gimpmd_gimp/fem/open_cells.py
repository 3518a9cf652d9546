"""Cells of the shared grid that a mesh leaves open."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from gimpmd_gimp.fem.mesh_file import MeshFile
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.planes import Interface


def open_cells(
    grid: BackgroundGrid, file: MeshFile, facets: Ints, owner: Floats, x: Floats, corner: Ints
) -> Bools:
    """Cells that the mesh leaves open: those which can be reached from beyond the inner facets.

    Parameters
    ----------
    owner : ndarray, shape ``(facets, d)``
        Centres of the elements of the facets.
    corner : ndarray of int64, shape ``(vertices, d)``
        Indices of the nodes of the vertices of these facets.
    """
    cells = np.arange(int(np.prod(grid.cells))).reshape(grid.cells)
    joins = list[Ints]()
    beyond, behind = list[Ints](), list[Ints]()
    normal = np.argmin(np.ptp(corner[facets], axis=1), axis=1)
    for axis, n in enumerate(grid.cells):
        wall = np.zeros((*grid.cells[:axis], n + 1, *grid.cells[axis + 1 :]), dtype=np.bool_)
        here = normal == axis
        place = corner[facets[here]].min(axis=1)
        wall[tuple(place.T)] = True
        free = ~wall.take(range(1, n), axis)
        joins.append(np.stack([cells.take(range(n - 1), axis)[free],
                               cells.take(range(1, n), axis)[free]]))  # fmt: skip
        above = owner[here, axis] < x[facets[here, 0], axis]  # the open cell lies above
        for found, upper in ((beyond, above), (behind, ~above)):
            index = place.copy()
            index[:, axis] -= ~upper
            found.append(cells[tuple(index.T)])
    i, j = np.concatenate(joins, axis=1)
    graph = sparse.coo_array((np.ones(i.size, dtype=np.int8), (i, j)), shape=(cells.size,) * 2)
    label = connected_components(graph, directed=False)[1]
    filled = np.isin(label, label[np.concatenate(beyond)])
    if filled[np.concatenate(behind)].any():
        file.refuse(
            "the edges at which it leaves room for the atoms are not closed, together with the "
            "faces of domain.box"
        )
    open_part = filled.reshape(grid.cells)
    for axis in range(grid.dim):
        ends = open_part.take(0, axis), open_part.take(-1, axis)
        if grid.periodic[axis] and (ends[0] != ends[1]).any():
            file.refuse(
                f"what it leaves open differs at the two periodic faces along {'xyz'[axis]}"
            )
    return open_part


def check_room(
    grid: BackgroundGrid, file: MeshFile, interface: Interface, filled: Bools, room: float
) -> None:
    """Check that cells of the grid hold all ghosts, and so many cells beyond the planes.

    Raises
    ------
    BackendError
        The mesh has elements there.
    """
    first, last = [], []
    for axis, ((start, end), planes) in enumerate(
        zip(interface.region, interface.planes, strict=True)
    ):
        h, low, n = grid.cell, grid.origin[axis], grid.cells[axis]
        beyond = [plane + shift for plane, shift in zip(planes, (-room * h, room * h), strict=True)]
        ends = start, end, *(place for place in beyond if np.isfinite(place))
        least, most = min(ends), max(ends)
        first.append(max(0, int(np.floor((least - low) / h + 1e-9))))
        last.append(min(n, int(np.ceil((most - low) / h - 1e-9))))
    if not filled[tuple(slice(*ends) for ends in zip(first, last, strict=True))].all():
        box = [
            [round(low + grid.cell * i, 9) for i in ends]
            for low, ends in zip(grid.origin, zip(first, last, strict=True), strict=True)
        ]
        file.refuse(
            f"it has elements in the box {box}, which it must leave open: there the ghost atoms "
            f"move with nodes of the grid (the MD region, and {_cells(room)} beyond the planes, in "
            "whole cells)"
        )


def _cells(count: float) -> str:
    return "a cell" if count == 1.0 else f"{count:g} cells"


def window_of(grid: BackgroundGrid, filled: Bools) -> tuple[BackgroundGrid, tuple[int, ...]]:
    """The smallest part of the grid around the filled cells, and its first cell."""
    ends = []
    for axis in range(grid.dim):
        others = tuple(a for a in range(grid.dim) if a != axis)
        used = np.flatnonzero(filled.any(axis=others))
        ends.append((int(used[0]), int(used[-1]) + 1) if used.size else (0, 1))
    first = tuple(start for start, _ in ends)
    window = BackgroundGrid(
        tuple(low + grid.cell * i for low, i in zip(grid.origin, first, strict=True)),
        grid.cell,
        tuple(end - start for start, end in ends),
        (False,) * grid.dim,
    )
    return window, first

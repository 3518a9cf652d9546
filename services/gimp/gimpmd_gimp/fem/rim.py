"""The outside of a mesh: facets of one element only, and where they lie.

Vertices near a face of the domain, or near the node of the grid at which they are meant to lie, are
moved there exactly.
"""

from __future__ import annotations

import numpy as np

from gimpmd_gimp.fem.mesh_file import MeshFile
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.grid.background import BackgroundGrid

MATCH = 1e-4
"""Distance, in cells, below which vertices of a mesh are moved to nodes of the grid and to faces of
the domain. Files in single precision are off by less."""

_FACETS: dict[str, tuple[tuple[int, ...], ...]] = {
    "quad": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "hexahedron": (
        (0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7),
    ),
    "tetra": ((0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3)),
}  # fmt: skip
"""Corners of the facets of an element: its edges, or its faces in three dimensions."""


def move_to_faces(grid: BackgroundGrid, file: MeshFile) -> Floats:
    """Vertices, those near a face of the domain exactly on it."""
    x, tolerance = file.x.copy(), MATCH * grid.cell
    for axis, faces in enumerate(grid.box):
        for face in faces:
            x[np.abs(x[:, axis] - face) < tolerance, axis] = face
    start, end = np.array(grid.box).T
    beyond = np.flatnonzero(((x < start) | (x > end)).any(axis=1))
    if beyond.size:
        file.refuse(
            f"the vertex at {point(x[beyond[0]])} and {beyond.size - 1} others lie outside "
            f"domain.box; the mesh has the units and the origin of the case"
        )
    return x


def find_rim(file: MeshFile, x: Floats) -> tuple[Ints, Floats]:
    """Facets of one element only, by their vertices, and the centre of the element of each.

    Beside facets with four vertices, those with three have their first one twice.
    """
    most = max(len(_FACETS[kind][0]) for kind in file.cells)
    facets, keys = list[Ints](), list[Ints]()
    centres = list[Floats]()
    for kind, cells in file.cells.items():
        centre = x[cells].mean(axis=1)
        for corners in _FACETS[kind]:
            fewer = most - len(corners)
            facets.append(cells[:, (*corners, *corners[:1] * fewer)])
            keys.append(np.pad(np.sort(cells[:, corners], axis=1), ((0, 0), (0, fewer)),
                               constant_values=-1))  # fmt: skip
            centres.append(centre)
    every = np.concatenate(facets)
    _, index, count = np.unique(np.concatenate(keys), axis=0, return_index=True, return_counts=True)
    if (count > 2).any():
        where = x[every[index[count > 2][0]]].mean(axis=0)
        file.refuse(f"more than two elements share the edge or face at {point(where)}")
    single = np.sort(index[count == 1])
    return every[single], np.concatenate(centres)[single]


def inner_facets(grid: BackgroundGrid, x: Floats, rim: Ints) -> Ints:
    """Facets that do not lie on a face of the domain."""
    on_face = np.zeros(len(rim), dtype=np.bool_)
    for axis, faces in enumerate(grid.box):
        for face in faces:
            on_face |= (x[rim, axis] == face).all(axis=1)
    return np.flatnonzero(~on_face)


def move_to_nodes(
    grid: BackgroundGrid, file: MeshFile, x: Floats, facets: Ints
) -> tuple[Floats, Ints]:
    """Vertices, those of inner facets exactly on nodes of the grid; and the indices of their nodes.

    Raises
    ------
    BackendError
        An inner facet is not a facet of a cell.
    """
    low, h = np.array(grid.origin), grid.cell
    corner = np.rint((x - low) / h).astype(np.int64)
    away = np.abs(x - (low + h * corner)).max(axis=1)
    size = np.ptp(corner[facets], axis=1)
    # one cell along all axes but one, with a vertex at each corner
    fits = (away[facets] < MATCH * h).all(axis=1)
    fits &= (size.sum(axis=1) == grid.dim - 1) & (size.max(axis=1, initial=0) == 1)
    if grid.dim == 3:
        fits &= np.array([len(set(facet)) == 4 for facet in facets.tolist()], dtype=np.bool_)
    if not fits.all():
        facet = facets[np.flatnonzero(~fits)[0]]
        shown = " to ".join(point(x[vertex]) for vertex in dict.fromkeys(facet.tolist()))
        file.refuse(
            f"the {'edge' if grid.dim == 2 else 'face'} {shown} belongs to one element only, and "
            f"is not an edge of a cell of the grid ({np.count_nonzero(~fits)} such). Neighbouring "
            "elements must share whole edges, and the outer ones must end at the faces of "
            "domain.box. Where the mesh leaves room for the atoms, its vertices must be the nodes "
            f"of the grid, {h:g} apart, counted from the lower corner of domain.box"
        )
    chosen = np.unique(facets)
    x = x.copy()
    x[chosen] = low + h * corner[chosen]
    corner[np.setdiff1d(np.arange(len(x)), chosen)] = -1
    return x, corner


def point(x: Floats) -> str:
    """A position, for messages."""
    return f"({', '.join(f'{value:.6g}' for value in x)})"

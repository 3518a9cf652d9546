"""A mesh from a file, joined to cells of the shared grid in the part that it leaves open.

Where the mesh ends inside the body, its edges must be those of cells of the grid. From there cells
fill the open part, up to the next edges of the mesh or to the faces of the domain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.spatial import cKDTree

from gimpmd_gimp.fem.mesh_elements import MeshPart, make_part
from gimpmd_gimp.fem.mesh_file import MeshFile
from gimpmd_gimp.fem.open_cells import check_room, open_cells, window_of
from gimpmd_gimp.fem.rim import (
    MATCH,
    find_rim,
    inner_facets,
    move_to_faces,
    move_to_nodes,
    point,
)
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.case.interface_nodes import FIT_CELLS
from gimpmd_schemas.grid.background import PAD, BackgroundGrid
from gimpmd_schemas.grid.planes import Interface

COVERED = 1e-6
"""Share of the body that elements may leave open or cover twice by rounding."""


@dataclass(frozen=True, eq=False)
class JoinedMesh:
    """Nodes of a mesh and of the cells that fill what it leaves open.

    Attributes
    ----------
    parts : tuple of MeshPart
        The elements of the mesh.
    nodes : ndarray, shape ``(nodes, d)``
        Positions at rest.
    row : ndarray of int64, shape ``(ids,)``
        Node of each node of the shared grid; -1 where there is none.
    window : BackgroundGrid
        The part of the shared grid around the filled cells.
    filled : ndarray of bool, of the shape of the window's cells
        Cells that are elements.
    window_row : ndarray of int64, shape ``(ids of the window,)``
        Node of each node of the window.
    """

    parts: tuple[MeshPart, ...]
    nodes: Floats
    row: Ints
    window: BackgroundGrid
    filled: Bools
    window_row: Ints


def join_mesh(
    grid: BackgroundGrid, interfaces: Sequence[Interface], file: MeshFile, absorbs: bool = False
) -> JoinedMesh:
    """Join a mesh to the cells that fill what it leaves open.

    Parameters
    ----------
    grid : BackgroundGrid
        The shared grid.
    interfaces : sequence of Interface
        Of the MD regions, for which the mesh must leave room.
    file : MeshFile
    absorbs : bool
        Whether there is an absorber, which sees more nodes beyond the planes.

    Raises
    ------
    BackendError
        The mesh does not fit the domain, the grid or the MD regions.
    """
    x = move_to_faces(grid, file)
    rim, owner = find_rim(file, x)
    facets = inner_facets(grid, x, rim)
    x, corner = move_to_nodes(grid, file, x, rim[facets])
    x, partner = _partners(grid, file, x)
    filled = open_cells(grid, file, rim[facets], owner[facets], x, corner)
    nodes, row, of_vertex = _number(grid, x, filled, corner, partner)
    parts = tuple(
        make_part(kind, x, cells, of_vertex, len(nodes)) for kind, cells in file.cells.items()
    )
    _check_parts(grid, file, parts, filled)
    room = FIT_CELLS[1] if absorbs else 1.0
    for interface in interfaces:
        check_room(grid, file, interface, filled, room)
    window, first = window_of(grid, filled)
    inner = tuple(slice(a, a + n) for a, n in zip(first, window.cells, strict=True))
    ids = np.indices(window.shape).reshape(grid.dim, -1) + np.array(first)[:, None]
    window_row = row[np.ravel_multi_index(tuple(ids), grid.shape)]
    return JoinedMesh(parts, nodes, row, window, filled[inner], window_row)


def _number(
    grid: BackgroundGrid, x: Floats, filled: Bools, corner: Ints, partner: Ints
) -> tuple[Floats, Ints, Ints]:
    """Number all nodes: first those of filled cells, then the other vertices.

    Parameters
    ----------
    corner : ndarray of int64, shape ``(vertices, d)``
        Indices of the nodes of vertices at filled cells; -1 for the other vertices.
    partner : ndarray of int64, shape ``(vertices,)``
        The vertex that each one repeats across periodic faces.

    Returns
    -------
    nodes : ndarray, shape ``(nodes, d)``
    row : ndarray of int64, shape ``(ids of the grid,)``
    of_vertex : ndarray of int64, shape ``(vertices,)``
    """
    touched = np.zeros(grid.shape, dtype=np.bool_)
    for shift in product((0, 1), repeat=grid.dim):
        part = tuple(slice(PAD + s, PAD + s + n) for s, n in zip(shift, grid.cells, strict=True))
        touched[part] |= filled
    images = grid.images()
    ids = np.unique(images[np.flatnonzero(touched)])
    row = np.full(grid.size, -1)
    row[ids] = np.arange(ids.size)
    row = row[images]

    on_grid = (corner >= 0).all(axis=1)
    of_vertex = np.full(len(x), -1)
    place = np.ravel_multi_index(tuple(corner[on_grid].T + PAD), grid.shape)
    of_vertex[on_grid] = row[place]
    new = np.flatnonzero((of_vertex < 0) & (partner == np.arange(len(x))))
    of_vertex[new] = ids.size + np.arange(new.size)
    rest = of_vertex < 0
    of_vertex[rest] = of_vertex[partner[rest]]
    return np.concatenate([grid.positions()[ids], x[new]]), row, of_vertex


def _partners(grid: BackgroundGrid, file: MeshFile, x: Floats) -> tuple[Floats, Ints]:
    """The vertex that each one repeats across periodic faces; others repeat themselves.

    Returns
    -------
    x : ndarray, shape ``(vertices, d)``
        Vertices, those on upper periodic faces exactly opposite their partners.
    partner : ndarray of int64, shape ``(vertices,)``

    Raises
    ------
    BackendError
        A vertex on a periodic face has no partner on the other one.
    """
    x, partner = x.copy(), np.arange(len(x))
    for axis, faces in enumerate(grid.box):
        if not grid.periodic[axis]:
            continue
        lower, upper = (np.flatnonzero(x[:, axis] == face) for face in faces)
        across = np.flatnonzero(np.arange(grid.dim) != axis)
        if lower.size == upper.size == 0:
            continue
        ends = [x[np.ix_(one, across)] for one in (lower, upper)]
        for mine, other, vertices in ((*ends[::-1], upper), (*ends, lower)):
            away = cKDTree(other).query(mine)[0] if other.size else np.full(len(mine), np.inf)
            if (away > MATCH * grid.cell).any():
                lost = x[vertices[np.argmax(away)]]
                file.refuse(
                    f"the vertex at {point(lost)} on a periodic face has no partner on the "
                    f"opposite face along {'xyz'[axis]}; mesh both faces alike"
                )
        partner[upper] = lower[cKDTree(ends[0]).query(ends[1])[1]]
        x[np.ix_(upper, across)] = x[np.ix_(partner[upper], across)]
    for _ in range(grid.dim - 1):  # a corner repeats the partner of its partner
        partner = partner[partner]
    return x, partner


def _check_parts(
    grid: BackgroundGrid, file: MeshFile, parts: tuple[MeshPart, ...], filled: Bools
) -> None:
    """Check that no element is folded, and that elements and filled cells cover the body once."""
    for part in parts:
        if (wrong := part.folded()).size:
            file.refuse(
                f"the element at {point(part.centres()[wrong[0]])} is folded or flat "
                f"({wrong.size} such)"
            )
    body = grid.cell**grid.dim * filled.size
    covered = sum(part.volume() for part in parts) + grid.cell**grid.dim * filled.sum()
    if abs(covered - body) > COVERED * body:
        file.refuse(
            f"its elements, and the cells of the grid where it leaves room for the atoms, cover "
            f"{covered:.6g}, but domain.box has {body:.6g}; the mesh must fill the body outside "
            "the atoms once"
        )

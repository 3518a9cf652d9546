"""Quadrature of elements, and those on the shared grid: bilinear quadrilaterals, or hexahedra.

The shape functions are those of scikit-fem. Elements in the continuum are integrated at two Gauss
points along each axis. An element that a plane of the interface crosses is integrated over the
boxes that fill its part of the continuum, at their centres: there the gradient of a shape function
is its mean over the box.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import sparse
from skfem import Basis, ElementHex1, ElementQuad1, MeshHex, MeshQuad

from gimpmd_gimp.coupling.interface.weights import Sparse, hats
from gimpmd_gimp.points.material_points import MaterialPoints
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.grid.background import PAD, BackgroundGrid

KINDS: dict[int, tuple[Any, Any]] = {2: (MeshQuad, ElementQuad1), 3: (MeshHex, ElementHex1)}
"""Mesh and element of scikit-fem, by dimension."""

GAUSS = 2
"""Gauss points along each axis; with fewer, some motions of an element would have no stiffness."""

ROUNDING = 1e-9
"""Share of an element's volume that is rounding."""


@dataclass(frozen=True, eq=False)
class Elements:
    """Quadrature points of all elements, and the masses of the nodes.

    Columns of the matrices, and entries of the mass, are the nodes. A node on a periodic face
    stands for its images.

    Attributes
    ----------
    reference : ndarray, shape ``(n, d)``
        Centres of the boxes that the quadrature points stand for. The boxes fill the elements; a
        Gauss point lies beside the centre of its box.
    half : ndarray, shape ``(n, d)``
        Half-widths of these boxes, in cells.
    volume : ndarray, shape ``(n,)``
        Weights of the points: volumes at rest (areas in two dimensions).
    values : sparse matrix, shape ``(n, nodes)``
        Shape functions at the points.
    gradient : tuple of sparse matrix
        Components of their gradients, each of shape ``(n, nodes)``.
    at_reference : sparse matrix, shape ``(n, nodes)``
        Shape functions at ``reference``.
    """

    reference: Floats
    half: Floats
    volume: Floats
    values: Sparse
    gradient: tuple[Sparse, ...]
    at_reference: Sparse

    def lumped_mass(self, density: float) -> Floats:
        """Sums of the rows of the consistent mass matrix, shape ``(nodes,)``."""
        return np.asarray(self.values.T @ (density * self.volume))

    def renumbered(self, number: Ints, count: int) -> Elements:
        """The same elements; node ``i`` becomes ``number[i]`` of ``count`` nodes."""
        return replace(
            self,
            values=renumber(self.values, number, count),
            gradient=tuple(renumber(matrix, number, count) for matrix in self.gradient),
            at_reference=renumber(self.at_reference, number, count),
        )


def renumber(matrix: Sparse, number: Ints, count: int) -> Sparse:
    """The matrix with column ``i`` as column ``number[i]`` of ``count``."""
    entries, shape = matrix.tocoo(), (matrix.shape[0], count)
    return sparse.coo_array((entries.data, (entries.row, number[entries.col])), shape).tocsr()


def make_elements(grid: BackgroundGrid, boxes: MaterialPoints) -> Elements:
    """Make the elements of the shared grid that boxes fill; its ids number the nodes.

    Parameters
    ----------
    grid : BackgroundGrid
    boxes : MaterialPoints
        Each of them lies in one cell. Cells that they do not fill are integrated over them.
    """
    make_mesh, make_element = KINDS[grid.dim]
    axes = [
        low + grid.cell * np.arange(n + 1) for low, n in zip(grid.origin, grid.cells, strict=True)
    ]
    mesh, element = make_mesh.init_tensor(*axes), make_element()
    cell_of_box, whole = _cells(grid, mesh, boxes)
    filled = np.unique(cell_of_box[whole])
    parts = []
    if filled.size:
        basis = Basis(mesh, element, elements=filled, intorder=2 * GAUSS - 1)
        edge, low = grid.cell / GAUSS, np.array(grid.origin)
        x = basis.mapping.F(basis.X, tind=basis.tind).reshape(grid.dim, -1).T
        centre = low + edge * (np.floor((x - low) / edge) + 0.5)
        parts.append(_on_grid(grid, mesh, basis, centre, np.full(x.shape, 0.5 / GAUSS)))
    if not whole.all():
        inside = cell_of_box[~whole]
        centre = boxes.reference[~whole].T[:, :, None]
        local = mesh.mapping().invF(centre, tind=inside)
        size = boxes.volume[~whole] / grid.cell**grid.dim  # of the reference element
        basis = Basis(mesh, element, elements=inside, quadrature=(local, size[:, None]))
        parts.append(_on_grid(grid, mesh, basis, boxes.reference[~whole], boxes.half[~whole]))
    return join(parts)


def _cells(grid: BackgroundGrid, mesh: Any, boxes: MaterialPoints) -> tuple[Ints, Bools]:
    """Element of each box, and whether the boxes of its element fill it."""
    centres = mesh.p[:, mesh.t].mean(axis=1).T
    number = np.full(grid.cells, -1)
    number[tuple(_index(grid, centres).T)] = np.arange(len(centres))
    inside = number[tuple(_index(grid, boxes.reference).T)]
    volume = np.bincount(inside, boxes.volume, minlength=len(centres))
    return inside, volume[inside] > (1.0 - ROUNDING) * grid.cell**grid.dim


def _index(grid: BackgroundGrid, x: Floats) -> Ints:
    """Indices of the cells that contain positions ``(n, d)``."""
    return np.floor((x - np.array(grid.origin)) / grid.cell).astype(np.int64)


def _on_grid(
    grid: BackgroundGrid, mesh: Any, basis: Any, reference: Floats, half: Floats
) -> Elements:
    """All quadrature points of a basis on the shared grid."""
    place = np.rint((mesh.p.T - np.array(grid.origin)) / grid.cell).astype(np.int64) + PAD
    ids = grid.images()[np.ravel_multi_index(tuple(place.T), grid.shape)]
    return quadrature(
        basis, ids[mesh.t[:, basis.tind]], grid.size, reference, half, hats(grid, reference)
    )


def quadrature(
    basis: Any, corners: Ints, count: int, reference: Floats, half: Floats, at_reference: Sparse
) -> Elements:
    """All quadrature points of a basis, element by element.

    Parameters
    ----------
    basis : skfem.Basis
    corners : ndarray, shape ``(corners, elements)``
        Nodes of the elements.
    count : int
        Number of all nodes.
    reference, half, at_reference
        As in `Elements`.
    """
    functions = [function[0] for function in basis.basis]
    return Elements(
        reference=reference,
        half=half,
        volume=basis.dx.ravel(),
        values=weights(basis, functions, corners, count),
        gradient=tuple(
            weights(basis, [function.grad[axis] for function in functions], corners, count)
            for axis in range(reference.shape[1])
        ),
        at_reference=at_reference,
    )


def weights(basis: Any, functions: Sequence[Floats], corners: Ints, count: int) -> Sparse:
    """A row for each quadrature point, from the values of each corner's function at all points."""
    shape = basis.dx.shape
    entries = np.stack([np.broadcast_to(function, shape).ravel() for function in functions])
    rows = np.broadcast_to(np.arange(basis.dx.size), entries.shape)
    nodes = np.repeat(corners, shape[1], axis=1)
    size = basis.dx.size, count
    return sparse.coo_array((entries.ravel(), (rows.ravel(), nodes.ravel())), size).tocsr()


def join(parts: Sequence[Elements]) -> Elements:
    """All elements, one part after the other."""
    return Elements(
        reference=np.concatenate([part.reference for part in parts]),
        half=np.concatenate([part.half for part in parts]),
        volume=np.concatenate([part.volume for part in parts]),
        values=sparse.vstack([part.values for part in parts], format="csr"),
        gradient=tuple(
            sparse.vstack(by_axis, format="csr")
            for by_axis in zip(*(part.gradient for part in parts), strict=True)
        ),
        at_reference=sparse.vstack([part.at_reference for part in parts], format="csr"),
    )

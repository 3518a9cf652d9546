"""Elements of a mesh from a file: quadrature, points on faces, and the longest stable time step.

Quadrilaterals and hexahedra are integrated at two Gauss points along each axis, triangles and
tetrahedra at their centre.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from skfem import (
    Basis,
    ElementHex1,
    ElementQuad1,
    ElementTetP1,
    ElementTriP1,
    FacetBasis,
    MeshHex,
    MeshQuad,
    MeshTet,
    MeshTri,
)
from skfem.io.meshio import INV_HEX_MAPPING

from gimpmd_gimp.fem.elements import GAUSS, Elements, quadrature, weights
from gimpmd_gimp.fem.face_points import FacePoints
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.mechanics.elasticity import voigt_place

AT_ONCE = 2048
"""Elements whose vibrations are computed together."""

_TENSOR, _SIMPLEX = 2 * GAUSS - 1, 1
"""Orders of integration."""

_SKFEM: dict[str, tuple[Any, Any, int, list[int]]] = {
    "quad": (MeshQuad, ElementQuad1, _TENSOR, [0, 1, 2, 3]),
    "triangle": (MeshTri, ElementTriP1, _SIMPLEX, [0, 1, 2]),
    "hexahedron": (MeshHex, ElementHex1, _TENSOR, INV_HEX_MAPPING[:8]),
    "tetra": (MeshTet, ElementTetP1, _SIMPLEX, [0, 1, 2, 3]),
}
"""Mesh and element of scikit-fem, order of integration, and place of its corners among meshio's."""


@dataclass(frozen=True, eq=False)
class MeshPart:
    """Elements of one kind.

    Attributes
    ----------
    mesh, element : skfem.Mesh, skfem.Element
    order : int
        Of integration.
    nodes : ndarray of int64, shape ``(vertices,)``
        Node of each vertex.
    count : int
        Number of all nodes of the body.
    """

    mesh: Any
    element: Any
    order: int
    nodes: Ints
    count: int

    @property
    def corners(self) -> Ints:
        """Nodes of the elements, shape ``(corners, elements)``."""
        return self.nodes[self.mesh.t]

    def elements(self, cell: float) -> Elements:
        """Quadrature of the elements.

        A box of the output is a part of the box around an element, as large as the volume of its
        quadrature point.

        Parameters
        ----------
        cell : float
            Edge of a cell of the shared grid, in which boxes are measured (length).
        """
        basis = Basis(self.mesh, self.element, intorder=self.order)
        dim, tensor = self.mesh.p.shape[0], self.order == _TENSOR
        middle = (np.floor(basis.X * GAUSS) + 0.5) / GAUSS if tensor else basis.X
        at_middle = Basis(self.mesh, self.element, quadrature=(middle, basis.W))
        span = np.ptp(self.mesh.p[:, self.mesh.t], axis=1)
        share = (basis.dx / span.prod(axis=0)[:, None]) ** (1.0 / dim)
        half = 0.5 * span[:, :, None] * share / cell
        return quadrature(
            basis,
            self.corners,
            self.count,
            basis.mapping.F(middle).reshape(dim, -1).T,
            half.reshape(dim, -1).T,
            weights(at_middle, [f[0] for f in at_middle.basis], self.corners, self.count),
        )

    def face_points(self, axis: int, place: float, tolerance: float) -> FacePoints:
        """Quadrature points of the faces of elements on a plane normal to an axis."""
        facets = self.mesh.boundary_facets()
        x = self.mesh.p[axis, self.mesh.facets[:, facets]]
        facets = facets[(np.abs(x - place) < tolerance).all(axis=0)]
        basis = FacetBasis(self.mesh, self.element, facets=facets, intorder=2 * GAUSS - 1)
        x = np.asarray(basis.global_coordinates()).reshape(self.mesh.p.shape[0], -1).T
        functions = [f[0] for f in basis.basis]
        return FacePoints(
            x, basis.dx.ravel(), weights(basis, functions, self.corners[:, basis.tind], self.count)
        )

    def volume(self) -> float:
        """Volume of all elements (area in two dimensions)."""
        return float(Basis(self.mesh, self.element, intorder=self.order).dx.sum())

    def folded(self) -> Ints:
        """Elements that are folded or flat: the map from the reference element is not one to one.

        The sign of its Jacobian is the same at all corners of other elements.
        """
        J = self.mesh.mapping().detDF(self.mesh.elem.refdom.p)
        scale = np.ptp(self.mesh.p[:, self.mesh.t], axis=1).prod(axis=0)[:, None]
        return np.flatnonzero((J * np.sign(J[:, :1]) <= 1e-6 * scale).any(axis=1))

    def centres(self) -> Floats:
        """Means of the corners, shape ``(elements, d)``."""
        return np.asarray(self.mesh.p[:, self.mesh.t].mean(axis=1).T)

    def frequencies(self, stiffness: Floats, density: float) -> Floats:
        """Largest angular frequency of each element by itself, with its lumped mass.

        The largest frequency of a body is at most that of one of its elements (Irons and Treharne,
        1971).

        Parameters
        ----------
        stiffness : ndarray
            Moduli at rest, in Voigt order (mechanical units).
        density : float
        """
        dim = self.mesh.p.shape[0]
        place = voigt_place(dim)
        C = stiffness[place[:, :, None, None], place[None, None]]
        found = []
        for first in range(0, self.mesh.nelements, AT_ONCE):
            chosen = np.arange(first, min(first + AT_ONCE, self.mesh.nelements))
            basis = Basis(self.mesh, self.element, elements=chosen, intorder=self.order)
            fields = [f[0] for f in basis.basis]
            shape = (dim, *basis.dx.shape)
            g = np.stack([np.broadcast_to(field.grad, shape) for field in fields])
            N = np.stack([np.broadcast_to(np.asarray(field), basis.dx.shape) for field in fields])
            mass = density * np.einsum("aeq,eq->ea", N, basis.dx)
            g = g / np.sqrt(mass.T)[:, None, :, None]
            stress = np.einsum("ijkl,bleq->ijbkeq", C, g)
            K = np.einsum("ajeq,ijbkeq,eq->eaibk", g, stress, basis.dx, optimize=True)
            size = g.shape[0] * dim
            found.append(np.linalg.eigvalsh(K.reshape(-1, size, size))[:, -1])
        return np.sqrt(np.concatenate(found))


def make_part(kind: str, x: Floats, cells: Ints, nodes: Ints, count: int) -> MeshPart:
    """Elements of one kind.

    Parameters
    ----------
    kind : str
        As meshio names it.
    x : ndarray, shape ``(vertices, d)``
    cells : ndarray, shape ``(elements, corners)``
        Their vertices, in the order of meshio.
    nodes : ndarray of int64, shape ``(vertices,)``
        Node of each vertex. Vertices on opposite periodic faces share a node.
    count : int
        Number of all nodes of the body.
    """
    make_mesh, make_element, order, corners = _SKFEM[kind]
    used, t = np.unique(cells, return_inverse=True)
    mesh = make_mesh(
        np.ascontiguousarray(x[used].T), np.ascontiguousarray(t.reshape(cells.shape).T[corners])
    )
    return MeshPart(mesh, make_element(), order, nodes[used], count)

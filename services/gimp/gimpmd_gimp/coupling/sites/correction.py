"""A small energy of the points near the planes that makes uniform strain exact at every node.

Points beyond plane 1 and near plane 2 get ``W += S0 : E + E : dA : E / 2`` per volume, E the
Green-Lagrange strain. Of all such energies that balance every node, at rest and to first order in
the strain, they get the one of least ``sum_p V_p |.|^2``. Energy, momentum and angular momentum are
kept by its form.

In some orientations of the crystal no such energy balances all nodes, because dA is symmetric. Then
the nodes near the planes get a *gradient term* in addition,
``sum_i c_imjk eps_m(i) (u_j(i + e_k) - 2 u_j(i) + u_j(i - e_k))``, where eps_m(i) is any measure of
the strain m at node i that is exact for uniform strain. It does no work under uniform strain, and
its coefficients c have no symmetry to obey.

Where planes end at faces of the body, not every uniform strain can be balanced in general either:
it exerts a couple where plane 2 meets the face. A free face carries no traction, so then the nodes
near it must be in balance under those uniform strains that have none there. Under strains that load
the face they are nearly so, and how nearly is said.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from gimpmd_gimp.coupling.interface.weights import Sparse
from gimpmd_gimp.coupling.sites.gradient_term import GradientTerm, second_differences
from gimpmd_gimp.coupling.sites.least_norm import factor, least_norm
from gimpmd_gimp.coupling.sites.pieces import Pieces
from gimpmd_gimp.coupling.sites.shells import Face, Shells, depth
from gimpmd_gimp.coupling.sites.spared import WEIGHT, Equations, Spared, near_faces
from gimpmd_gimp.coupling.sites.touched import touched
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.background import PAD, BackgroundGrid
from gimpmd_schemas.mechanics.elasticity import VOIGT, unit_strains, voigt_place

DEPTH = 1.75
"""Points within this many cells of plane 2 are corrected."""

GRADIENT = 1e-3
"""Weight of the gradient term among the unknowns, times a cell to the power of ``(d - 2) / 2``: it
takes what dA cannot, and no more."""

CENTRAL = 1e-6
"""Largest error of Cauchy's relation, over the stiffness, at which it counts as exact."""

NEARLY = 2e-2
"""Largest accepted residual near a face of the body under a strain that loads it, over the traction
on the face of a cell."""

LARGEST_CHANGE, LEAST_TANGENT = 0.15, 0.8
"""Largest accepted dA over C11, and least stiffness of a point over that of the crystal, in any
strain."""

BALANCED = 1e-8
"""Largest accepted residual, over the traction on the face of a cell. Differences of forces at
strains of 1e-4 have an error that need not be in balance: up to 2e-9 at faces of the body."""


@dataclass(frozen=True, eq=False)
class Correction:
    """Coefficients of the corrected pieces (pressure units).

    Attributes
    ----------
    S0 : ndarray, shape ``(n, c)``
        Second Piola-Kirchhoff stress at rest, in Voigt order.
    dA : ndarray, shape ``(n, c, c)``
        Change of the moduli, Voigt with engineering shear; symmetric.
    gradient : GradientTerm or None
        None if there is no need of it.
    left : float
        Largest nodal residual of a uniform strain after the correction, over the traction of the
        softest strain on the face of a cell.
    at_faces : float
        The same of nodes near faces of the body under strains that load these, if they are spared;
        otherwise 0.
    """

    S0: Floats
    dA: Floats  # noqa: N815
    gradient: GradientTerm | None
    left: float
    at_faces: float


def corrected(pieces: Pieces, shells: Shells, cell: float) -> Bools:
    """Which pieces are corrected: those beyond plane 1 within ``DEPTH`` cells of plane 2."""
    return np.asarray(~pieces.free & (depth(shells.active, pieces.x) > -DEPTH * cell))


def nodes_of_body(grid: BackgroundGrid) -> Bools:
    """Nodes in the body or on its faces that are not repeated; shape ``(grid.size,)``."""
    keep = grid.canonical().reshape(grid.shape)
    for axis, (count, periodic) in enumerate(zip(grid.cells, grid.periodic, strict=True)):
        if not periodic:
            index = np.arange(grid.shape[axis]) - PAD
            within = (index >= 0) & (index <= count)
            keep = keep & np.expand_dims(within, tuple(k for k in range(grid.dim) if k != axis))
    return np.asarray(keep.ravel(), dtype=np.bool_)


def weights(grid: BackgroundGrid, pieces: Pieces, T: Sparse) -> tuple[list[Sparse], Bools, Bools]:
    """Gradients of the nodes that are freedoms in some pieces, and which nodes have equations.

    Returns
    -------
    slopes : list of sparse matrix, shape ``(pieces, grid.size)``
    reached : ndarray of bool, shape ``(grid.size,)``
        Freedoms in the body that move a piece.
    bare : ndarray of bool, shape ``(grid.size,)``
        Freedoms in the body that move none.
    """
    slopes = [slope @ T for slope in pieces.slopes(grid)]
    inner = nodes_of_body(grid) & (abs(T).sum(axis=0) > 0.0)
    found = touched(*slopes)
    return slopes, inner & found, inner & ~found


def correct(
    grid: BackgroundGrid,
    pieces: Pieces,
    T: Sparse,
    at_rest: Floats,
    change: Floats,
    stress: Floats,
    faces: Sequence[Face] = (),
) -> Correction:
    """Find the correction of least norm.

    Parameters
    ----------
    pieces : Pieces
        The corrected ones.
    T : sparse matrix, shape ``(grid.size, grid.size)``
        Ties slaves to other nodes; see `slaves.constraints`.
    at_rest : ndarray, shape ``(grid.size, d)``
        Residual at rest, before T; see `residual`.
    change : ndarray, shape ``(c, grid.size, d)``
        Its derivative in the strains of `unit_strains`.
    stress : ndarray, shape ``(c, d, d)``
        Derivative of the stress of the crystal in these strains (pressure).
    faces : sequence of Face
        Faces of the body at which planes end.

    Raises
    ------
    BackendError
        A node with a residual is reached by no corrected piece, or the residuals cannot be
        balanced.
    """
    dim = grid.dim
    scale = traction_of(stress) * grid.cell ** (dim - 1)
    slopes, reached, bare = weights(grid, pieces, T)
    at_rest = T.T @ at_rest
    change = np.stack([T.T @ part for part in change])
    _check_cover(grid, bare, np.concatenate([at_rest[None], change]), scale)
    nodes = np.flatnonzero(reached)
    G = [slope.tocsc()[:, nodes].tocsr() for slope in slopes]
    root = np.sqrt(pieces.volume)

    places = grid.positions()[nodes]
    x, rest = _solved(System(G, root, _rest_numbers(dim)), places, at_rest[nodes, :, None].ravel())
    S0 = x.reshape(len(root), -1) / root[:, None]
    worst_at_rest = _worst(rest) / scale

    wanted = change[:, nodes].copy()
    full = S0[:, voigt_place(dim)]
    for m, H in enumerate(unit_strains(dim)):
        P = np.einsum("ij,njk->nik", H, full)
        for k, slope in enumerate(G):
            wanted[m] -= slope.T @ (pieces.volume[:, None] * P[:, :, k])
    b = np.ascontiguousarray(wanted.transpose(1, 2, 0)).ravel()
    system = System(G, root, change_numbers(dim))
    spares = bool(faces) and not _is_central(stress)
    if not spares:
        x, rest = _solved(system, places, b)
        spares = bool(faces) and _worst(rest) > BALANCED * scale
    gradient, at_faces = None, 0.0
    if spares:
        weight = WEIGHT * grid.cell ** (0.5 * (dim - 2))
        spared = Spared(system, *near_faces(places, faces, stress, grid.cell), weight)
        x, rest = _solved(spared, places, spared.turned(b))
        x, forces = np.split(x, [system.of_pieces])
        at_faces = _worst(weight * forces) / scale
    elif _worst(rest) > BALANCED * scale:
        centres, bends = second_differences(grid, nodes, T)
        weight = GRADIENT * grid.cell ** (0.5 * (dim - 2))
        x, rest = _solved(System(G, root, change_numbers(dim), weight * bends), places, b)
        x, extra = np.split(x, [system.of_pieces])
        extra = weight * extra.reshape(len(centres), dim, dim, len(change)).swapaxes(2, 3)
        gradient = GradientTerm(centres, extra)
    worst = max(worst_at_rest, _worst(rest) / scale)
    if worst > BALANCED or at_faces > NEARLY:
        raise BackendError(
            f"under uniform strain {max(worst, at_faces):.1e} of the traction is left at a node "
            "near the planes; the planes must lie midway between layers of atoms: use larger "
            "cells, or move md.region by half a cell or away from faces of the body"
        )
    numbers = x.reshape(len(root), -1) / root[:, None]
    return Correction(S0, numbers[:, _pairs(dim)], gradient, worst, at_faces)


def traction_of(stress: Floats) -> float:
    """Largest component of the stress of the softest unit strain; see `correct`."""
    return float(np.abs(stress).max(axis=(1, 2)).min())


def _is_central(stress: Floats) -> bool:
    """Whether Cauchy's relation ``C12 = C44`` holds along all axes, as with pair potentials."""
    dim, size = stress.shape[1], np.abs(stress).max()
    place = voigt_place(dim)
    pairs = [(i, j) for i in range(dim) for j in range(i)]
    return all(
        abs(stress[place[i, i], j, j] - stress[place[i, j], i, j]) < CENTRAL * size
        for i, j in pairs
    )


def _solved(equations: Equations, places: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Solution of least norm, and what is left, of equations of nodes at ``places``."""
    solve = factor(equations.normal(), places)
    return least_norm(equations.forward, equations.backward, solve, b)


def _worst(rest: Floats) -> float:
    return float(np.abs(rest).max(initial=0.0))


def check_moduli(found: Correction, stiffness: Floats) -> None:
    """Raise `BackendError` if a correction is larger than those whose stability has been tried.

    Parameters
    ----------
    stiffness : ndarray, shape ``(c, c)``
        Of the crystal at rest, Voigt with engineering shear (pressure).
    """
    largest = float(np.abs(found.dA).max(initial=0.0)) / stiffness[0, 0]
    inverse = np.linalg.inv(np.linalg.cholesky(stiffness))
    relative = np.linalg.eigvalsh(inverse @ (stiffness + found.dA) @ inverse.T)
    least = float(relative.min(initial=1.0))
    if largest > LARGEST_CHANGE or least < LEAST_TANGENT:
        raise BackendError(
            f"the points near the planes would need other moduli by {largest:.2g} of C11, and "
            f"would have {least:.2g} of the crystal's stiffness in some direction; only up to "
            f"{LARGEST_CHANGE:g} and down to {LEAST_TANGENT:g} is known to be stable: move the "
            "planes away from node lines, or use larger cells"
        )


def _check_cover(grid: BackgroundGrid, bare: Bools, residuals: Floats, scale: float) -> None:
    """Raise if a node that no corrected piece reaches is out of balance."""
    size = np.where(bare, np.abs(residuals).max(axis=(0, 2)), 0.0)
    worst = int(np.argmax(size))
    if size[worst] > BALANCED * scale:
        place = ", ".join(f"{c:g}" for c in grid.positions()[worst])
        raise BackendError(
            f"the node at ({place}) is out of balance under uniform strain by "
            f"{size[worst] / scale:.1e} of the traction, and no continuum near it can be "
            "corrected: move plane 1 so that it leaves a share of .05 to .7 of its cell to the "
            "continuum"
        )


class System:
    """The equations ``sum_p V_p sigma_p grad S = r`` for numbers of the points, times sqrt(V).

    Parameters
    ----------
    G : sequence of sparse matrix, shape ``(points, nodes)``
        Gradients of the weights.
    root : ndarray, shape ``(points,)``
        Square roots of the volumes.
    numbers : ndarray of int, shape ``(d, d, k)``
        Which number of a point is its stress component i, j in the strain m of k strains.
    bends : sparse matrix, shape ``(nodes, l)``, optional
        Forces of the gradient term, per coefficient; there is one for each column, component and
        strain. These follow the numbers of the points in the solution.

    Attributes
    ----------
    of_pieces : int
        How many numbers of the points there are.
    """

    def __init__(
        self, G: Sequence[Sparse], root: Floats, numbers: Ints, bends: Sparse | None = None
    ) -> None:
        self._G, self._root, self._numbers, self._bends = G, root, numbers, bends
        self._count = int(numbers.max()) + 1
        self._nodes = G[0].shape[1]
        self.of_pieces = len(root) * self._count

    def forward(self, x: Floats) -> Floats:
        """Nodal forces, a row for each node, component and strain."""
        x, coefficients = np.split(x, [self.of_pieces])
        x = x.reshape(-1, self._count) * self._root[:, None]
        dim, _, strains = self._numbers.shape
        force = np.zeros((self._nodes, dim, strains))
        if self._bends is not None:
            bent = self._bends @ coefficients.reshape(self._bends.shape[1], dim * strains)
            force += bent.reshape(force.shape)
        for j, slope in enumerate(self._G):
            for i in range(dim):
                force[:, i] += slope.T @ x[:, self._numbers[i, j]]
        return force.ravel()

    def backward(self, u: Floats) -> Floats:
        """Transpose of `forward`."""
        dim, _, strains = self._numbers.shape
        u = u.reshape(self._nodes, dim, strains)
        x = np.zeros((len(self._root), self._count))
        for j, slope in enumerate(self._G):
            for i in range(dim):
                x[:, self._numbers[i, j]] += slope @ u[:, i]
        of_pieces = (x * self._root[:, None]).ravel()
        if self._bends is None:
            return of_pieces
        return np.concatenate([of_pieces, (self._bends.T @ u.reshape(self._nodes, -1)).ravel()])

    def normal(self) -> Sparse:
        """The normal matrix ``A A^T``, a sum of products of small matrices.

        ``K = sum_jk (G_j^T V G_k) (x) D_jk``, where D says which equations of two nodes have a
        number of the points in common.
        """
        dim, _, strains = self._numbers.shape
        V = sparse.diags_array(self._root**2)
        K = sparse.csr_array((self._nodes * dim * strains,) * 2)
        for j in range(dim):
            for k in range(dim):
                D = sparse.csr_array(self._in_common(j, k).astype(float))
                K = K + sparse.kron(self._G[j].T @ V @ self._G[k], D, format="csr")
        if self._bends is not None:
            each = sparse.eye_array(dim * strains)
            K = K + sparse.kron(self._bends @ self._bends.T, each, format="csr")
        return K

    def graph(self) -> Sparse:
        """Which nodes move a piece in common; shape ``(nodes, nodes)``, entries not zero."""
        moved = sum(abs(slope) for slope in self._G)
        return sparse.csr_array(moved.T @ moved)

    def bound(self) -> int:
        """How many pairs of equations of two such nodes have a number of the points in common."""
        dim = len(self._G)
        return int(np.any([self._in_common(j, k) for j, k in np.ndindex(dim, dim)], axis=0).sum())

    def _in_common(self, j: int, k: int) -> Bools:
        """Which equations of a node, by gradients along j, and of another, along k, are bound."""
        return self._numbers[:, j].ravel()[:, None] == self._numbers[:, k].ravel()


def _pairs(dim: int) -> Ints:
    """Number of each entry of a symmetric matrix of Voigt components, shape ``(c, c)``."""
    c = len(VOIGT[dim])
    upper = np.triu_indices(c)
    number = np.empty((c, c), dtype=np.int64)
    number[upper] = np.arange(len(upper[0]))
    number.T[upper] = number[upper]
    return number


def _rest_numbers(dim: int) -> Ints:
    """Numbers of S0: its components."""
    return voigt_place(dim)[:, :, None]


def change_numbers(dim: int) -> Ints:
    """Numbers of dA: the entries of a symmetric matrix, by stress component and strain."""
    return _pairs(dim)[voigt_place(dim)]

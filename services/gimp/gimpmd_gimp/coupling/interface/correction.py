"""A small energy of the points near the planes that makes uniform strain exact at every node.

Rods leave no force along a plane when the crystal is strained uniformly, but at corners, and where
a plane meets a face of the domain, no choice of weights does. The points within a cell of the
planes therefore get ``W += S0 : E + E : dA : E / 2``, E the Green-Lagrange strain, once for all: of
all such energies that balance every node, at rest and to first order in the strain, the one of
least ``sum_p V_p |.|^2``. Momentum, angular momentum and energy are kept by its form.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from gimpmd_gimp.coupling.interface.bonds import Bonds, crossing_weights, domain
from gimpmd_gimp.coupling.interface.lattice import MODES, Lattice
from gimpmd_gimp.coupling.interface.weights import Sparse, gradients, means
from gimpmd_gimp.points.material_points import MaterialPoints, take
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.background import PAD, BackgroundGrid
from gimpmd_schemas.grid.planes import Interface

END = 3.0
"""Cells from where a plane meets the rim of the domain, within which the rim is left to itself."""

SHIFT = 1e-13
"""Of the largest diagonal entry: keeps the singular normal equations solvable."""

ROUNDS = 30
"""Refinements at most."""

BALANCED = 1e-9
"""Residual, over the traction on a cell, beyond which uniform strain is not in balance."""

EXACT = 1e-14
"""Residual, over the right side, at which refinement stops."""

_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Independent components of dA in Voigt's notation."""


@dataclass(frozen=True, eq=False)
class Correction:
    """Points near the planes and their coefficients (mechanical units).

    Attributes
    ----------
    id : ndarray of int64, shape ``(n,)``
    reference, half : ndarray, shape ``(n, 2)``
        As the points have them.
    volume : ndarray, shape ``(n,)``
    S0 : ndarray, shape ``(n, 3)``
        Second Piola-Kirchhoff stress at rest, Voigt.
    dA : ndarray, shape ``(n, 3, 3)``
        Change of the moduli, Voigt with engineering shear.
    """

    id: Ints
    reference: Floats
    half: Floats
    volume: Floats
    S0: Floats
    dA: Floats  # noqa: N815

    @property
    def count(self) -> int:
        """Number of points."""
        return int(self.id.size)

    def take(self, chosen: Ints | Bools) -> Correction:
        """Points chosen by a mask or by indices."""
        return Correction(**{f.name: getattr(self, f.name)[chosen] for f in fields(self)})


def join(parts: Sequence[Correction]) -> Correction:
    """Points of all parts, one part after the other."""
    return Correction(
        **{
            f.name: np.concatenate([getattr(part, f.name) for part in parts])
            for f in fields(Correction)
        }
    )


def near_planes(points: MaterialPoints, interface: Interface, cell: float) -> Bools:
    """Which points, cut at the planes, are less than a cell from the free atoms."""
    outside = np.zeros(points.count)
    for axis, (low, high) in enumerate(interface.planes):
        x = points.reference[:, axis]
        outside = np.maximum(outside, np.maximum(low - x, x - high))
    return outside < cell


def correct(
    points: MaterialPoints,
    lattice: Lattice,
    bonds: Bonds,
    interface: Interface,
    grid: BackgroundGrid,
) -> Correction:
    """Coefficients of all points near the planes.

    The bulk's stress is the crystal's own, whatever law the points have, so that a law that is
    somewhat off leaves its error where it is and is not hidden here.

    Parameters
    ----------
    points : MaterialPoints
        Cut at the planes; all that ``near_planes`` chooses, of all ranks. Their order does not
        matter.
    bonds : Bonds
        All of the interface.

    Raises
    ------
    BackendError
        No correction balances uniform strain.
    """
    points = take(points, near_planes(points, interface, grid.cell))
    points = take(points, np.argsort(points.id))
    families = traction_families(lattice, bonds, interface, grid)
    G = [
        sparse.diags_array(points.volume) @ by_axis
        for by_axis in gradients(grid, points.reference, points.half)
    ]
    touched = np.zeros(grid.size, dtype=np.bool_)
    for matrix in (*G, sparse.csr_array(families)):
        touched[matrix.indices] = True
    nodes = np.flatnonzero(touched & balanced(interface, grid))
    weight = 1.0 / np.sqrt(points.volume)
    scale = sparse.diags_array(-weight)
    gx, gy = ((scale @ matrix.tocsc()[:, nodes]).T.tocsr() for matrix in G)
    empty = sparse.csr_array(gx.shape)
    # nodal force per stress component of a point
    T = [sparse.vstack([gx, empty]), sparse.vstack([empty, gy]), sparse.vstack([gy, gx])]
    families = families[:, nodes]

    at_rest = (families.T @ lattice.forces(np.eye(2))).T.ravel()
    changes = np.einsum("mij,vjk,mk->vmi", lattice.stiffnesses(), MODES, lattice.bonds)
    traction = max(np.abs(lattice.stress(q)).max() for q in changes) * grid.cell
    S0 = _least(sparse.hstack(T, format="csr"), -at_rest, traction).reshape(3, -1)

    right = []
    for H, q in zip(MODES, changes, strict=True):
        P = H @ S0[[[0, 2], [2, 1]]].transpose(2, 0, 1)
        pull = [gx @ P[:, i, 0] + gy @ P[:, i, 1] for i in range(2)]
        right.append(-(families.T @ q).T.ravel() - np.concatenate(pull))
    blocks: list[list[Sparse]] = [[None] * 6 for _ in range(3)]
    for column, (i, j) in enumerate(_PAIRS):
        blocks[j][column], blocks[i][column] = T[i], T[j]
    M = sparse.block_array(blocks, format="csr")
    x = _least(M, np.concatenate(right), traction).reshape(6, -1)
    dA = np.empty((points.count, 3, 3))
    for component, (i, j) in zip(x * weight, _PAIRS, strict=True):
        dA[:, i, j] = dA[:, j, i] = component
    return Correction(
        points.id, points.reference, points.half, points.volume, (S0 * weight).T.copy(), dA
    )


def inner_nodes(grid: BackgroundGrid) -> Bools:
    """Canonical nodes whose hats do not reach beyond the domain."""
    keep = grid.canonical().reshape(grid.shape)
    for axis in range(2):
        if not grid.periodic[axis]:
            index = np.arange(grid.shape[axis]) - PAD
            inside = (index >= 1) & (index <= grid.cells[axis] - 1)
            keep = keep & (inside[:, None] if axis == 0 else inside[None, :])
    return keep.ravel()


def balanced(interface: Interface, grid: BackgroundGrid) -> Bools:
    """Nodes at which uniform strain is to be in balance, on the whole grid.

    All but those on the rim of the domain near the place where a plane meets it. There crystal and
    continuum end together; the crystal's surface has a stress of its own, which the rim takes up.
    Elsewhere on the rim, what is in balance is the interface by itself: loads and bulk are.
    """
    low, high = domain(grid)
    x = grid.positions()
    rim = grid.canonical() & ~inner_nodes(grid)
    for axis, planes in enumerate(interface.planes):
        across = 1 - axis
        for plane in planes:
            for end, limit in zip(
                (low[across], high[across]), interface.planes[across], strict=True
            ):
                if np.isfinite(plane) and not np.isfinite(limit) and not grid.periodic[across]:
                    away = np.maximum(np.abs(x[:, axis] - plane), np.abs(x[:, across] - end))
                    rim &= away > END * grid.cell
    return inner_nodes(grid) | rim


def traction_families(
    lattice: Lattice, bonds: Bonds, interface: Interface, grid: BackgroundGrid
) -> Floats:
    """Nodal force per unit force in each kind of bond, where the crystal is strained uniformly.

    Parameters and returns as of the sum ``F_i = sum_k g_ki q_k``, g of shape ``(m, grid.size)``:
    points filled up to the planes pull with ``P n`` along these (``-sum_p V_p P grad S_ip`` is a
    closed integral of ``N_i P n``); rods and ghosts together leave ``-q W_i`` at the crossings.
    Tractions on faces of the domain are left out.
    """
    m = lattice.bonds.shape[0]
    choose = sparse.csr_array(
        (bonds.sign, (bonds.kind, np.arange(bonds.count))), shape=(m, bonds.count)
    )
    families: Floats = -(choose @ crossing_weights(bonds, lattice, grid)).toarray()
    low, high = domain(grid)
    core = [
        (max(plane[0], lo), min(plane[1], hi))
        for plane, lo, hi in zip(interface.planes, low, high, strict=True)
    ]
    for axis, planes in enumerate(interface.planes):
        for plane, outward in zip(planes, (-1.0, 1.0), strict=True):
            if np.isfinite(plane):
                ends = np.array([[plane, plane]] * 2)
                ends[:, 1 - axis] = core[1 - axis]
                mean = means(grid, ends[:1], ends[1:]).toarray()[0]
                length = ends[1, 1 - axis] - ends[0, 1 - axis]
                through = outward * lattice.bonds[:, axis] / lattice.area
                families += length * through[:, None] * mean
    return families


def _least(M: Sparse, b: Floats, traction: float) -> Floats:
    """Least solution of ``M x = b``, a system with dependent but consistent equations.

    ``x = M^T y`` with ``M M^T y = b``: sparse factors of the shifted normal matrix, and
    refinement, which leaves the shift without effect.
    """
    A = (M @ M.T).tocsc()
    shift = SHIFT * A.diagonal().max(initial=1.0)
    solver = splu(
        A + shift * sparse.eye_array(A.shape[0], format="csc"),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    x, rest = np.zeros(M.shape[1]), b
    for _ in range(ROUNDS):
        better = x + M.T @ solver.solve(rest)
        left = b - M @ better
        if np.abs(left).max(initial=0.0) > 0.5 * np.abs(rest).max(initial=0.0):
            break
        x, rest = better, left
        if np.abs(rest).max(initial=0.0) <= EXACT * np.abs(b).max():
            break
    left = np.abs(rest).max(initial=0.0) / traction
    if left > BALANCED:
        raise BackendError(
            f"coupling.crystal: under uniform strain {left:.1e} of the traction is left at a node "
            "near the planes; along a periodic axis of domain.box, and along planes, the crystal "
            "must repeat with the length; otherwise use coupling.scheme: velocity"
        )
    return x

"""The lowest mode of the energy of free atoms and nodes around the planes.

A set-up with a mode of negative stiffness is not stable: the mode grows whatever the time step is.
The continuum ends a few cells beyond the planes and is free there. More continuum can only add
stiffness.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, eigsh

from gimpmd_gimp.coupling.interface.weights import Sparse
from gimpmd_gimp.coupling.sites.layout import Layout, measured
from gimpmd_gimp.coupling.sites.multifrontal import Multifrontal
from gimpmd_gimp.coupling.sites.pieces import Pieces, cut_cells
from gimpmd_gimp.coupling.sites.shells import faces_met
from gimpmd_gimp.coupling.sites.terms import SiteTerms, stiffness, terms_at_rest
from gimpmd_gimp.coupling.sites.touched import touched
from gimpmd_schemas.arrays import Bools, Floats
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.mechanics.elasticity import voigt_place
from gimpmd_schemas.mechanics.units import UNITS
from gimpmd_schemas.wire.answers import LowestMode
from gimpmd_schemas.wire.stiffness import MOST, Stiffness

AROUND = 3.0
"""Cells around the second planes whose nodes are freedoms; corrections reach 1.75 cells."""

ROUND_OFF = 1e-8
"""Stiffness, over the largest, that counts as none: that of rigid motions."""

SURFACE = 1e-5
"""The same with faces of the body: a rotation gains or loses energy by the surface's stress."""

SHIFT = 1e-4
"""Stiffness, over the largest, that is added before the matrix is factored. It lies well above that
of rigid motions, so that the factors are accurate, and below that of most other modes."""

ACCURACY = 1e-6
"""Of the vectors of the lowest modes; the error of their stiffness is of second order."""

SEED = 1


class Modes(NamedTuple):
    """Lowest modes of a symmetric matrix.

    Attributes
    ----------
    values : ndarray, shape ``(k,)``
        Eigenvalues over the largest, ascending.
    vectors : ndarray, shape ``(n, k)``
    """

    values: Floats
    vectors: Floats


def check_modes(plan: Plan, layout: Layout, atoms: Stiffness) -> LowestMode:
    """Find the lowest mode of a plan.

    Parameters
    ----------
    atoms : Stiffness
        As the MD side has measured it.

    Raises
    ------
    BackendError
        A mode has negative stiffness.
    """
    grid, dim = layout.grid, plan.dim
    pieces = cut_cells(grid, layout.shells, AROUND)
    moving = _moving(plan, layout, pieces)
    freedoms = atoms.x.size + dim * int(moving.sum())
    if freedoms > MOST[dim]:
        return LowestMode(freedoms=freedoms, stiffness=None)
    C = UNITS[plan.units].stress_to_mechanical(1.0) * plan.stiffness()
    of_nodes = stiffness_of_nodes(grid, pieces, C, terms_at_rest(plan, layout))
    K, x = together(grid, layout.T, atoms, of_nodes, moving)
    found = lowest_modes(K, x, dim * (dim + 1) // 2 + 1)
    none = SURFACE if faces_met(grid, layout.shells) else ROUND_OFF
    if found.values[0] < -none:
        place = x[np.argmax(np.abs(found.vectors[:, 0])) // dim]
        raise BackendError(_unstable(plan, float(found.values[0]), place))
    above = found.values[found.values > none]
    return LowestMode(freedoms=freedoms, stiffness=float(above.min(initial=found.values[-1])))


def _unstable(plan: Plan, value: float, place: Floats) -> str:
    """What is said of a mode of negative stiffness."""
    interfaces = plan.coupled.interfaces
    depth = [float(interface.depth(place[None])[0]) for interface in interfaces]
    number = int(np.argmax(depth))
    key = "md.region" if len(interfaces) == 1 else f"md.regions[{number}]"
    box = ", ".join(f"[{low:g}, {high:g}]" for low, high in interfaces[number].region)
    at = ", ".join(f"{c:.4g}" for c in place)
    return (
        f"{key} = [{box}]: the set-up is not stable: atoms and nodes near ({at}) have a mode of "
        f"negative stiffness, {value:.1e} of the largest; move the faces of the region by half a "
        "cell, use larger cells (grid.cell), or check that continuum.material has the moduli of "
        "the crystal"
    )


def _moving(plan: Plan, layout: Layout, pieces: Pieces) -> Bools:
    """Nodes that are freedoms and move a ghost or a piece of the continuum."""
    found = touched(*pieces.take(~pieces.free).slopes(layout.grid))
    found[list(measured(plan).nodes)] = True
    return np.asarray((abs(layout.T).T @ found > 0.0) & (layout.T.diagonal() != 0.0))


def stiffness_of_nodes(grid: BackgroundGrid, pieces: Pieces, C: Floats, terms: SiteTerms) -> Sparse:
    """Second derivatives of the continuum's energy in the displacements of all nodes.

    Parameters
    ----------
    pieces : Pieces
        With all that are corrected.
    C : ndarray, shape ``(c, c)``
        Of the law beyond plane 2, Voigt (pressure).
    terms : SiteTerms
        Of all regions.
    """
    place, dim = voigt_place(grid.dim), grid.dim
    stiff = pieces.take(~pieces.active)
    A = np.broadcast_to(C[place[:, :, None, None], place[None, None]], (len(stiff.x), *(dim,) * 4))
    linear = terms.linear(grid)
    rows = (linear.nodes[:, None] * dim + np.arange(dim)).ravel()
    onto = sparse.csr_array(
        (np.ones(rows.size), (np.arange(rows.size), rows)), shape=(rows.size, grid.size * dim)
    )
    return stiffness(stiff.slopes(grid), stiff.volume, A) - onto.T @ linear.matrix @ onto


def together(
    grid: BackgroundGrid, T: Sparse, atoms: Stiffness, of_nodes: Sparse, moving: Bools
) -> tuple[Sparse, Floats]:
    """Stiffness of free atoms and of nodes that are freedoms, and their places.

    Parameters
    ----------
    T : sparse matrix, shape ``(grid.size, grid.size)``
        Ties slaves to other nodes; see `slaves.constraints`.
    moving : ndarray of bool, shape ``(grid.size,)``
        Nodes that are freedoms.

    Returns
    -------
    K : sparse matrix in rows, shape ``(n d, n d)``
    x : ndarray, shape ``(n, d)``
    """
    d, n = grid.dim, atoms.x.size
    free = sparse.eye_array(n)
    nodes = sparse.kron(T, sparse.eye_array(d), format="csc")[:, np.repeat(moving, d)]
    onto = sparse.block_diag([free, nodes], format="csr")
    every = atoms.matrix + sparse.block_diag([sparse.csr_array((n, n)), of_nodes], format="csr")
    K = sparse.csr_array(onto.T @ every @ onto)
    return K, np.concatenate([atoms.x, grid.positions()[moving]])


def lowest_modes(K: Sparse, x: Floats, count: int) -> Modes:
    """The lowest modes of a symmetric matrix, of which k rows belong to each of some places.

    Lanczos's method with the inverse of K and a shift. If K has modes that are softer than that,
    there is no Cholesky factor, and the shift grows.

    Parameters
    ----------
    x : ndarray, shape ``(n, d)``
        Places.
    """
    start = np.random.default_rng(SEED).normal(size=K.shape[0])
    largest = float(eigsh(K, k=1, which="LA", v0=start, return_eigenvectors=False)[0])
    shift, fronts = SHIFT * largest, None
    while fronts is None:
        try:
            fronts = Multifrontal(_shifted(K, shift), x)
        except np.linalg.LinAlgError:
            shift *= 10.0
    inverse = LinearOperator(K.shape, matvec=fronts.solve)
    values, vectors = eigsh(K, k=count, sigma=-shift, v0=start, OPinv=inverse, tol=ACCURACY)
    order = np.argsort(values)
    return Modes(values[order] / largest, vectors[:, order])


def _shifted(K: Sparse, by: float) -> Sparse:
    return sparse.csr_array(K + by * sparse.eye_array(K.shape[0]))

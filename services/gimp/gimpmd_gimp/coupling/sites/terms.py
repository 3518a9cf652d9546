"""What corrected pieces add on the continuum's side: an energy of nodal displacements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from gimpmd_gimp.coupling.interface.terms import LinearTerms
from gimpmd_gimp.coupling.interface.weights import Sparse
from gimpmd_gimp.coupling.sites.correction import check_moduli, correct, corrected
from gimpmd_gimp.coupling.sites.gradient_term import GradientTerm
from gimpmd_gimp.coupling.sites.layout import Layout, measured
from gimpmd_gimp.coupling.sites.pieces import Pieces
from gimpmd_gimp.coupling.sites.residual import residual
from gimpmd_gimp.coupling.sites.shells import faces_met
from gimpmd_gimp.coupling.solver_protocol import ContinuumSolver
from gimpmd_gimp.laws.thermal import stress_of_plan
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.case.form import Sites
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.mechanics.elasticity import VOIGT, voigt_place
from gimpmd_schemas.mechanics.units import UNITS


@dataclass(frozen=True, eq=False)
class SiteTerms:
    """Corrected pieces, and the nodes that they touch.

    Attributes
    ----------
    nodes : ndarray of int64, shape ``(n,)``
        Ids on the shared grid; nodal arrays have a row for each.
    volume : ndarray, shape ``(p,)``
    S0, dA : ndarray, shapes ``(p, c)`` and ``(p, c, c)``
        See `correction.Correction` (mechanical units).
    slopes : tuple of sparse matrix, shape ``(p, n)``
        Displacement gradients along each axis.
    load : ndarray, shape ``(n, d)``
        Constant forces, against those of surfaces of the crystal at rest.
    gradient : GradientTerm or None
        For small strains.
    """

    nodes: Ints
    volume: Floats
    S0: Floats
    dA: Floats  # noqa: N815
    slopes: tuple[Sparse, ...]
    load: Floats
    gradient: GradientTerm | None

    def evaluate(self, U: Floats) -> tuple[float, Floats]:
        """Energy, less that at rest, and nodal forces, at nodal displacements ``(n, d)``."""
        dim = U.shape[1]
        F = np.eye(dim) + np.stack([slope @ U for slope in self.slopes], axis=2)
        C = 0.5 * (np.einsum("pki,pkj->pij", F, F) - np.eye(dim))
        E = np.stack([C[:, i, j] * (1.0 if i == j else 2.0) for i, j in VOIGT[dim]], axis=1)
        change = np.einsum("pvw,pw->pv", self.dA, E)
        energy = float(self.volume @ ((self.S0 + 0.5 * change) * E).sum(axis=1))
        P = F @ (self.volume[:, None] * (self.S0 + change))[:, voigt_place(dim)]
        force = np.zeros_like(U)
        for axis, slope in enumerate(self.slopes):
            force -= slope.T @ P[:, :, axis]
        return energy - float((self.load * U).sum()), force + self.load

    def linear(self, grid: BackgroundGrid) -> LinearTerms:
        """The same for small strains: forces to first order in the displacements."""
        dim = len(self.slopes)
        place, V = voigt_place(dim), self.volume
        A = self.dA[:, place[:, :, None, None], place[None, None]]
        A = A + np.einsum("ik,pjl->pijkl", np.eye(dim), self.S0[:, place])
        matrix, load = -stiffness(self.slopes, V, A), self.load.copy()
        if self.gradient is not None:
            matrix = matrix + self.gradient.forces(grid, self.nodes)
        for j, slope in enumerate(self.slopes):
            load -= slope.T @ (V[:, None] * self.S0[:, place][:, :, j])
        return LinearTerms(self.nodes, matrix.tocsr(), load)


def stiffness(slopes: Sequence[Sparse], volume: Floats, A: Floats) -> Sparse:
    """Second derivatives of the energy of pieces in nodal displacements; shape ``(n d, n d)``.

    Parameters
    ----------
    slopes : sequence of sparse matrix, shape ``(p, n)``
        Displacement gradients along each axis.
    volume : ndarray, shape ``(p,)``
    A : ndarray, shape ``(p, d, d, d, d)``
        Derivative of the Piola stress (i, j) in the displacement gradient (k, m).
    """
    dim = len(slopes)
    # rows by piece, component and axis
    gradients = sum(
        sparse.kron(slope, np.eye(dim * dim)[:, axis::dim], format="csr")
        for axis, slope in enumerate(slopes)
    )
    weighted = (volume[:, None, None, None, None] * A).reshape(-1, dim * dim, dim * dim)
    parts = weighted, np.arange(len(weighted)), np.arange(len(weighted) + 1)
    size = len(weighted) * dim * dim
    between = sparse.bsr_array(parts, shape=(size, size)).tocsr()
    return sparse.csr_array(gradients.T @ between @ gradients)


def terms_at_rest(plan: Plan, layout: Layout) -> SiteTerms:
    """Energy of the interfaces of all MD regions at zero temperature.

    Raises
    ------
    BackendError
        See `site_terms`.
    """
    sites, c = measured(plan), len(VOIGT[plan.dim])
    return _terms(layout, sites, *_measured_strains(sites, plan.dim), np.zeros(c))[0]


def site_terms(
    plan: Plan, layout: Layout, solver: ContinuumSolver
) -> tuple[SiteTerms | LinearTerms, float, tuple[str, ...]]:
    """Energy of the interfaces of all MD regions, this rank's part; how far the law is off; notes.

    Raises
    ------
    BackendError
        Uniform strain cannot be balanced at the planes, or only by a correction so large that it
        may be unstable.
    """
    sites = measured(plan)
    force, stress = _measured_strains(sites, plan.dim)
    whole, at_faces = _terms(layout, sites, force, stress, stress_of_plan(plan))
    places = layout.grid.positions()[whole.nodes]
    if whole.gradient is not None and solver.law.finite:
        raise BackendError(
            "coupling.scheme: sites: in this orientation of the crystal the planes need a gradient "
            "term, which is for small strains only: turn the crystal, or use a linear "
            "continuum.material"
        )
    mine = _take(whole, layout.grid, solver.owns(_corrected_places(layout)), solver.owns(places))
    return (
        mine if solver.law.finite else mine.linear(layout.grid),
        _misfit(plan, stress),
        _notes(at_faces),
    )


def _notes(at_faces: float) -> tuple[str, ...]:
    """What is to be said of the correction."""
    if at_faces == 0.0:
        return ()
    return (
        "where planes end at a face of the body, only uniform strains without traction on the face "
        f"are in balance; under strains that load it {at_faces:.1e} of the traction is left at "
        "nodes within a cell of the face",
    )


def _corrected_places(layout: Layout) -> Floats:
    pieces = layout.pieces
    return pieces.x[corrected(pieces, layout.shells, layout.grid.cell)]


def _measured_strains(sites: Sites, dim: int) -> tuple[Floats, Floats]:
    """Nodal forces ``(1 + c, n, d)`` and stresses ``(1 + c, d, d)`` at rest and by strain."""
    count = 1 + len(VOIGT[dim])
    force = np.frombuffer(sites.force, dtype="<f8").reshape(count, len(sites.nodes), dim)
    stress = np.frombuffer(sites.stress, dtype="<f8").reshape(count, dim, dim)
    return force, stress


def _terms(
    layout: Layout, sites: Sites, force: Floats, stress: Floats, thermal: Floats
) -> tuple[SiteTerms, float]:
    """The energy of all corrected pieces, and the residual at faces of the body.

    Ghosts do not vibrate, so pieces between the planes have the thermal stress of the crystal, as
    material points have beyond plane 2. It begins at the first layer of ghosts: there the free
    atoms push, through their bonds across plane 1.
    """
    grid, pieces = layout.grid, layout.pieces
    near = pieces.take(corrected(pieces, layout.shells, grid.cell))
    nodal = np.zeros((len(force), grid.size, grid.dim))
    nodal[:, list(sites.nodes)] = force
    left = [residual(grid, pieces, f, P) for f, P in zip(nodal, stress, strict=True)]
    faces = faces_met(grid, layout.shells)
    found = correct(grid, near, layout.T, left[0], np.stack(left[1:]), stress[1:], faces)
    check_moduli(found, stiffness_of(stress))
    slopes, load = near.slopes(grid), -_surface(sites, layout)
    nodes = _touched(load, slopes)
    if found.gradient is not None:
        nodes = np.union1d(nodes, found.gradient.touched(grid))
    terms = SiteTerms(
        nodes=nodes,
        volume=near.volume,
        S0=found.S0 + _share_of_ghosts(layout, near, sites)[:, None] * thermal,
        dA=found.dA,
        slopes=tuple(slope[:, nodes].tocsr() for slope in slopes),
        load=load[nodes],
        gradient=found.gradient,
    )
    return terms, found.at_faces


def _touched(load: Floats, slopes: Sequence[Sparse]) -> Ints:
    """Rows of nodes that have a load, or belong to a piece."""
    parts = [np.flatnonzero(load.any(axis=1)), *(slope.indices for slope in slopes)]
    return np.unique(np.concatenate(parts)).astype(np.int64)


def _share_of_ghosts(layout: Layout, pieces: Pieces, sites: Sites) -> Floats:
    """Share of each piece that lies between the first layer of ghosts and plane 2."""
    first = [
        tuple(
            (low - 0.5 * layer, high + 0.5 * layer)
            for (low, high), layer in zip(box, sites.layers, strict=True)
        )
        for box in layout.shells.free
    ]
    return np.where(pieces.active, 1.0 - pieces.share(first, layout.grid.cell), 0.0)


def _surface(sites: Sites, layout: Layout) -> Floats:
    """Forces at rest of surfaces of the crystal, on the nodes that are freedoms; ``(size, d)``.

    The ghosts cannot relax as the surface of the crystal does, so the nodes must not feel it.
    """
    grid = layout.grid
    force = np.zeros((grid.size, grid.dim))
    if sites.surface:
        force[list(sites.nodes)] = np.frombuffer(sites.surface, dtype="<f8").reshape(-1, grid.dim)
    return np.asarray(layout.T.T @ force)


def _take(terms: SiteTerms, grid: BackgroundGrid, chosen: Bools, own: Bools) -> SiteTerms:
    """The part of some pieces, and the load and the gradient term on own nodes."""
    slopes = [slope[chosen] for slope in terms.slopes]
    load, gradient = np.where(own[:, None], terms.load, 0.0), terms.gradient
    used = _touched(load, slopes)
    if gradient is not None:
        gradient = gradient.take(np.isin(gradient.nodes, terms.nodes[own]))
        used = np.union1d(used, np.searchsorted(terms.nodes, gradient.touched(grid)))
    return SiteTerms(
        nodes=terms.nodes[used],
        volume=terms.volume[chosen],
        S0=terms.S0[chosen],
        dA=terms.dA[chosen],
        slopes=tuple(slope[:, used].tocsr() for slope in slopes),
        load=load[used],
        gradient=gradient,
    )


def stiffness_of(stress: Floats) -> Floats:
    """Stiffness of the crystal, Voigt, from its stresses ``(1 + c, d, d)`` by strain."""
    dim = stress.shape[1]
    C = np.array([[P[i, j] for i, j in VOIGT[dim]] for P in stress[1:]])
    return np.asarray(0.5 * (C + C.T))


def _misfit(plan: Plan, stress: Floats) -> float:
    """Largest difference of a component of the stiffness at rest, over its largest component."""
    C, unit = stiffness_of(stress), UNITS[plan.units].stress_to_mechanical(1.0)
    return float(np.abs(unit * plan.stiffness() - C).max() / np.abs(C).max())

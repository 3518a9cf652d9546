"""Interfaces of scheme FS around boxes of atoms, with their correction."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from mpi4py import MPI
from scipy import sparse
from scipy.spatial import cKDTree

from gimpmd_gimp.coupling.interface.weights import Sparse, means
from gimpmd_gimp.coupling.sites import correction, slaves
from gimpmd_gimp.coupling.sites.correction import Correction
from gimpmd_gimp.coupling.sites.modes import stiffness_of_nodes, together
from gimpmd_gimp.coupling.sites.pieces import Pieces, cut_cells
from gimpmd_gimp.coupling.sites.residual import residual
from gimpmd_gimp.coupling.sites.shells import Shells, faces_met, grown, inside
from gimpmd_gimp.coupling.sites.terms import SiteTerms
from gimpmd_gimp.coupling.sites.touched import touched
from gimpmd_md.coupling.shape_functions import ShapeFunctions
from gimpmd_md.crystal.cell import Cell, settled
from gimpmd_md.crystal.inner_shift import InnerShift, tensors
from gimpmd_md.crystal.plane_pairs import Planes, pairs
from gimpmd_md.crystal.recognise import Crystal as Lattice
from gimpmd_md.crystal.recognise import CrystalSites, distances, recognise
from gimpmd_md.crystal.site_off.measure import forces, inner_shifts, stress
from gimpmd_md.crystal.site_off.stiffness import stiffness
from gimpmd_md.engines.lammps.site_off.commands import Potential
from gimpmd_md.engines.lammps.site_off.double import with_off_sites
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.zones import Box
from gimpmd_schemas.mechanics.elasticity import VOIGT, unit_strains, voigt_place
from gimpmd_schemas.mechanics.units import UNITS
from gimpmd_schemas.wire.stiffness import Stiffness
from tests.copper_sites import SILICON
from tests.services.gimp.coupling.sites.crystals import FCC, Bodies, Crystal, upright
from tests.services.md.crystal.site_off.crystals import Sample, potential_of
from tests.services.md.crystal.site_off.crystals import crystal as made

STEP = 1e-4
"""Strain of the central differences."""

CUBIC = np.eye(3)
"""Axes along the edges of a cubic cell."""

BEYOND = 3.0
"""Crystal beyond faces of the body, in cutoffs."""

MARGIN = 3.0
"""Continuum around the boxes of active sites, in cells: 1.75 and more than one."""


@dataclass(frozen=True)
class Setup:
    """A crystal, cells, and shells around boxes of free atoms.

    Where a box has no lower plane it ends at a face of the body, at 0; planes meet it there.
    Along the axes of ``rounds`` the body repeats after so many cells, a period of the crystal or
    several, and has no planes.
    """

    crystal: Crystal
    cell: float
    shells: Shells
    rounds: Mapping[int, int] = field(default_factory=dict, kw_only=True)

    @cached_property
    def grid(self) -> BackgroundGrid:
        ends = np.array(grown(self.shells.active, MARGIN * self.cell))
        low = ends[:, :, 0].min(axis=0)
        low = np.floor(np.where(np.isfinite(low), low, 0.0) / self.cell)
        high = np.ceil(ends[:, :, 1].max(axis=0) / self.cell)
        high[list(self.rounds)] = list(self.rounds.values())
        return BackgroundGrid(
            origin=tuple((low * self.cell).tolist()),
            cell=self.cell,
            cells=tuple((high - low).astype(int).tolist()),
            periodic=tuple(axis in self.rounds for axis in range(self.crystal.dim)),
        )

    @cached_property
    def bodies(self) -> Bodies:
        """Free atoms, then ghosts, then the crystal beyond faces of the body, then images."""
        reach, length = 1.001 * self.crystal.cutoff, self._length
        within = grown(self.shells.active, reach)
        low, high = (np.array(within)[:, :, k] for k in (0, 1))
        low, high = low.min(axis=0), high.max(axis=0)
        low = np.where(np.isfinite(low), low, -BEYOND * self.crystal.cutoff)
        around = np.isfinite(length)
        low[around], high[around] = -reach, length[around] + reach
        x = self.crystal.sites(tuple(zip(low, high, strict=True)))
        x = x[inside(within, x)]
        image = ((x < 0.0) | (x > length))[:, around].any(axis=1)
        order = 4 * image + 2 * ~self._in_body(x) + ~inside(self.shells.free, x)
        x = x[np.argsort(order, kind="stable")]
        own = (~image).sum()
        moved = np.floor(x[own:, around] / length[around]) * length[around]
        repeated = x[own:].copy()
        repeated[:, around] -= moved
        distance, which = cKDTree(x[:own]).query(repeated)
        assert np.all(distance < 1e-6), "the body is not a period of the crystal long"
        active = inside(self.shells.active, x) & (np.arange(len(x)) < own)
        return Bodies(self.crystal, x, active, which)

    @property
    def _length(self) -> np.ndarray:
        """After which the body repeats along each axis; infinite where it does not."""
        cells = [self.rounds.get(axis, np.inf) for axis in range(self.crystal.dim)]
        return self.cell * np.array(cells)

    def _in_body(self, x: np.ndarray) -> np.ndarray:
        faces = np.isneginf(np.array(self.shells.free)[:, :, 0].min(axis=0))
        faces[list(self.rounds)] = False
        return np.asarray((x[:, faces] > 0.0).all(axis=1))

    @cached_property
    def real(self) -> Bodies:
        """The atoms of the body alone, and their images."""
        every = self.bodies
        here = self._in_body(every.x)
        return Bodies(
            self.crystal, every.x[here], every.active[here], every.images[here[every.own :]]
        )

    @cached_property
    def free(self) -> int:
        """Number of free atoms."""
        return int(inside(self.shells.free, self.real.x[: self.real.own]).sum())

    @cached_property
    def pieces(self) -> Pieces:
        return cut_cells(self.grid, self.shells)

    @cached_property
    def weights(self) -> Sparse:
        x, reach = self.real.x[self.free : self.real.own], 0.5 * self.crystal.period
        return means(self.grid, x - reach, x + reach)

    @cached_property
    def moves(self) -> Sparse:
        """How the components of the nodes move those of the ghosts."""
        return sparse.csr_array(sparse.kron(self.weights, sparse.eye_array(self.crystal.dim)))

    @cached_property
    def T(self) -> Sparse:
        found = slaves.find_slaves(self.grid, self.shells, self.touched)
        return slaves.constraints(self.grid, found, self.covered)

    @cached_property
    def covered(self) -> np.ndarray:
        """Nodes whose hats reach into the continuum."""
        return touched(*self.pieces.take(~self.pieces.free).slopes(self.grid))

    @cached_property
    def touched(self) -> np.ndarray:
        """Nodes that move a ghost or a piece of the continuum."""
        return self.covered | touched(self.weights)

    @cached_property
    def residuals(self) -> dict[bytes, np.ndarray]:
        """Residuals that have been found, by deformation."""
        return {}

    def residual(self, F: np.ndarray) -> np.ndarray:
        key = F.tobytes()
        if key not in self.residuals:
            self.residuals[key] = self._residual(F)
        return self.residuals[key].copy()

    def _residual(self, F: np.ndarray) -> np.ndarray:
        on_ghosts = self.force(F)[self.free : self.real.own]
        nodal = (self.moves.T @ on_ghosts.ravel()).reshape(self.grid.size, -1)
        return residual(self.grid, self.pieces, nodal, self.stress(F))

    @cached_property
    def changes(self) -> np.ndarray:
        eye = np.eye(self.crystal.dim)
        return np.stack(
            [
                (self.residual(eye + STEP * H) - self.residual(eye - STEP * H)) / (2.0 * STEP)
                for H in unit_strains(self.crystal.dim)
            ]
        )

    def force(self, F: np.ndarray) -> np.ndarray:
        """On all atoms that are no images, free ones first."""
        return self.bodies.force(F)

    def stress(self, F: np.ndarray) -> np.ndarray:
        return self.crystal.stress(F)

    @cached_property
    def stresses(self) -> np.ndarray:
        """Derivative of the stress in each strain."""
        eye = np.eye(self.crystal.dim)
        return np.stack(
            [
                (self.stress(eye + STEP * H) - self.stress(eye - STEP * H)) / (2.0 * STEP)
                for H in unit_strains(self.crystal.dim)
            ]
        )

    @property
    def traction(self) -> float:
        return correction.traction_of(self.stresses)

    def tangent(self) -> np.ndarray:
        """Derivative of the stress at rest, shape ``(d, d, d, d)``."""
        return self.crystal.tangent()

    @cached_property
    def stiffness(self) -> np.ndarray:
        """Voigt, of the crystal at rest."""
        A, voigt = self.tangent(), VOIGT[self.crystal.dim]
        C = np.array([[A[i, j, k, m] for k, m in voigt] for i, j in voigt])
        return 0.5 * (C + C.T)

    @cached_property
    def corrected(self) -> Pieces:
        return self.pieces.take(correction.corrected(self.pieces, self.shells, self.cell))

    @cached_property
    def correction(self) -> Correction:
        eye = np.eye(self.crystal.dim)
        return correction.correct(
            self.grid,
            self.corrected,
            self.T,
            self.residual(eye),
            self.changes,
            self.stresses,
            faces_met(self.grid, self.shells),
        )

    def energy(self) -> tuple[Sparse, np.ndarray]:
        """Second derivatives of the energy in free atoms and nodes, and their places."""
        d, size, found = self.crystal.dim, self.grid.size, self.correction
        terms = SiteTerms(
            np.arange(size),
            self.corrected.volume,
            found.S0,
            found.dA,
            self.corrected.slopes(self.grid),
            np.zeros((size, d)),
            found.gradient,
        )
        of_nodes = stiffness_of_nodes(self.grid, self.pieces, self.stiffness, terms)
        onto = sparse.block_diag([sparse.eye_array(d * self.free), self.moves], format="csr")
        atoms = Stiffness(self.real.x[: self.free], onto.T @ self.of_atoms() @ onto)
        free = self.touched & (self.T.diagonal() != 0.0)
        return together(self.grid, self.T, atoms, of_nodes, free)

    def hessian(self) -> np.ndarray:
        """The same, dense."""
        return np.asarray(self.energy()[0].toarray())

    def of_atoms(self) -> Sparse:
        """Second derivatives of the energy of the active sites in all atoms."""
        return self.real.hessian()


@dataclass(frozen=True)
class Measured(Setup):
    """The same with forces and stresses by LAMMPS, of a periodic cell and of a cluster.

    The cell holds sites of the crystal, and its atoms relax if need be.
    """

    periodic: Cell
    potential: Potential
    folder: Path

    @cached_property
    def lattice(self) -> Lattice:
        """The crystal of the cell as it is recognised; that of the sites may be moved."""
        reach = 3.0 * self.crystal.period.max()
        x = self.crystal.sites(((-reach, reach),) * self.crystal.dim) - self.crystal.midway
        return recognise(x, np.ones(len(x), dtype=int))

    def member(self, x: np.ndarray) -> np.ndarray:
        """Which atom of the basis is at each site of the cell."""
        found = self.lattice
        return distances(found.vectors, found.origin, found.basis, x).argmin(axis=0)

    def apart(self, F: np.ndarray) -> np.ndarray:
        """Inner shifts of the basis at a deformation."""
        self.periodic.deform(np.eye(self.crystal.dim))
        x = self.periodic.engine.vectors("x")[np.argsort(self.periodic.engine.atoms("id"))]
        return inner_shifts(self.periodic, self.lattice, CrystalSites(x, self.member(x)), F)

    @cached_property
    def shift(self) -> InnerShift:
        eye, found = np.eye(self.crystal.dim), self.lattice
        by_strain = [
            (self.apart(eye + STEP * H) - self.apart(eye - STEP * H)) / (2.0 * STEP)
            for H in unit_strains(self.crystal.dim)
        ]
        kappa = tensors(np.swapaxes(by_strain, 0, 1))
        origin = found.origin + self.crystal.midway
        return InnerShift(found.vectors, origin, found.basis, kappa)

    @cached_property
    def moves(self) -> Sparse:
        canonical = np.flatnonzero(self.grid.canonical())
        half = 0.5 * self.crystal.period / self.cell
        functions = ShapeFunctions(self.grid, canonical, half, self.shift)
        x, d = self.real.x[self.free : self.real.own], self.crystal.dim
        _, stencils, _ = functions.marked(np.ones(len(x), dtype=np.int32), 1, x)
        columns = [
            sparse.csr_array(stencils.interpolate(unit.reshape(-1, d)).reshape(1, -1))
            for unit in np.eye(d * len(canonical))
        ]
        onto = sparse.csr_array(
            (np.ones(len(canonical)), (np.arange(len(canonical)), canonical)),
            shape=(len(canonical), self.grid.size),
        )
        every = sparse.vstack(columns, format="csr").T
        return sparse.csr_array(every @ sparse.kron(onto, sparse.eye_array(d)))

    def force(self, F: np.ndarray) -> np.ndarray:
        x = self.bodies.x
        member = self.member(x - self.crystal.midway)
        moved = x @ F.T + self.apart(F)[member]
        off = ~self.bodies.active
        (found,) = self.acting(x, np.ones(len(x), dtype=int), off, [moved])
        return np.asarray(self.bodies.fold.T @ found)

    def acting(
        self, x: np.ndarray, kinds: np.ndarray, off: np.ndarray, moved: Sequence[np.ndarray]
    ) -> np.ndarray:
        """Forces of a cluster by LAMMPS."""
        return forces(self.potential, "metal", x, kinds, 1, off, moved, MPI.COMM_SELF, self.folder)

    def stress(self, F: np.ndarray) -> np.ndarray:
        return stress(self.periodic, F) / UNITS["metal"].nktv2p

    def tangent(self) -> np.ndarray:
        place = voigt_place(self.crystal.dim)
        return np.moveaxis(self.stresses[place], (0, 1), (2, 3))

    def of_atoms(self) -> Sparse:
        atoms, away = self.real, self.crystal.midway
        lattice = replace(self.lattice, origin=self.lattice.origin + away)
        x = atoms.x[: atoms.own]
        sites, active = CrystalSites(x, self.member(x - away)), atoms.active[: atoms.own]
        body = [(0.0, end) if np.isfinite(end) else None for end in self._length.tolist()]
        return stiffness(lattice, sites, active, self.crystal.cutoff, body, self.acting)


def by_the_rule(
    crystal: Crystal, cell: float, boxes: list[Box], rounds: Mapping[int, int] | None = None
) -> Setup:
    """Planes by the rule around wanted boxes of free atoms; none at infinite ends."""
    free, active = [], []
    for box in boxes:
        found = [
            [
                _planes(crystal, cell, axis, outward, end)
                for outward, end in zip((-1.0, 1.0), ends, strict=True)
            ]
            for axis, ends in enumerate(box)
        ]
        free.append(tuple((low.first, high.first) for low, high in found))
        active.append(tuple((low.second, high.second) for low, high in found))
    return Setup(crystal, cell, Shells(tuple(free), tuple(active)), rounds=rounds or {})


@contextmanager
def silicon(
    folder: Path, axes: np.ndarray = CUBIC
) -> Iterator[tuple[Callable[..., Measured], Crystal]]:
    """Interfaces of silicon by Stillinger and Weber, with the arguments of `by_the_rule`.

    In place of the crystal, which is returned too, they take its offset. ``axes`` are indices of
    the crystal, in rows.
    """
    a = SILICON.constant
    edges, basis = upright(np.concatenate([FCC, FCC + 0.25]), axes)
    orient = " ".join(
        f"orient {axis} {' '.join(f'{i:.0f}' for i in row)}"
        for axis, row in zip("xyz", axes, strict=True)
    )
    diamond = f"diamond {a!r} origin {SILICON.place} {orient}"
    sample = Sample(diamond, (1, 1, 1), "sw", "* * Si.sw Si")
    with made(sample, folder) as cell:
        period = a * edges
        lattice = Crystal(period, period * basis, period, cell.engine.pair_cutoff(), none)
        potential = with_off_sites(potential_of(sample), 1, folder)

        def interface(
            offset: np.ndarray | None,
            h: float,
            boxes: list[Box],
            rounds: Mapping[int, int] | None = None,
        ) -> Measured:
            moved = replace(lattice, offset=offset)
            found = by_the_rule(moved, h, boxes, rounds)
            return Measured(
                moved, h, found.shells, settled(cell), potential, folder, rounds=found.rounds
            )

        yield interface, lattice


def none(r: np.ndarray, order: int) -> np.ndarray:
    """Stands for the energy of a pair."""
    raise AssertionError("LAMMPS knows the energy")


def _planes(crystal: Crystal, cell: float, axis: int, outward: float, end: float) -> Planes:
    if np.isinf(end):
        return Planes(end, end, 0.5)
    midway = float(crystal.midway[axis])
    found = pairs(end, outward, crystal.layers[axis], midway, crystal.cutoff, cell)
    if not found:
        raise BackendError("no plane midway between layers of atoms")
    return found[0]

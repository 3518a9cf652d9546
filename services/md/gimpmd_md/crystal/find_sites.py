"""What a strained crystal does at the planes of the sites scheme, measured by LAMMPS.

Near the planes the atoms must form a perfect crystal. LAMMPS gives the inner shifts of its basis,
the forces on the ghosts, and the stress of the crystal, at rest and at small strains. The continuum
corrects its points with them, so that uniform strain is in balance at every node.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from gimpmd_md.crystal import inner_shift
from gimpmd_md.crystal.cell import Cell, cell_of, settled
from gimpmd_md.crystal.check import where
from gimpmd_md.crystal.place_planes import WAY_OUT, layer, place
from gimpmd_md.crystal.recognise import SAME, Crystal, CrystalSites, recognise
from gimpmd_md.crystal.site_off.measure import Relaxed, forces, inner_shifts, stress
from gimpmd_md.engines.lammps.library import Engine, unit_style
from gimpmd_md.engines.lammps.off_types import OffTypes, double_types
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.case.derive.levels import background_grid, finest_cell
from gimpmd_schemas.case.derive.zones import zones as zones_of
from gimpmd_schemas.case.form import FACES, Case, Planes, Sites
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.particle_grid import (
    gimp_stencils,
    in_cells,
    particles_to_grid,
    window_of,
)
from gimpmd_schemas.grid.planes import NO_WEIGHT, Interface
from gimpmd_schemas.grid.zones import Box, MdRegion
from gimpmd_schemas.mechanics.elasticity import unit_strains
from gimpmd_schemas.mechanics.units import UNITS

STRAIN = 1e-4
"""Strain of the central differences."""

RELAXED = 1e-12
"""Forces on the relaxed atoms of a primitive cell, over the force of a strain of 1 %. Errors of the
inner shifts are this large in strains of 1 %, and need not be in balance."""

SURFACE_RELAXED = 1e-8
"""Norm of the forces on the relaxed free atoms at a surface, over the largest force on a ghost."""

NO_SHIFT = 1e-8
"""Inner shifts smaller than this per unit strain, over a primitive vector, are zero by symmetry."""

DEPTH = 3.0
"""Free atoms this deep below the planes, in cutoffs, take part in the measurement. Forces on ghosts
depend on atoms up to two cutoffs deep; one more gives free atoms whose forces must vanish."""

PERFECT = 2.0
"""Depth below the planes, in cutoffs, to which the crystal must be perfect."""

UNBALANCED = 1e-6
"""Largest accepted force on a free atom of the strained crystal, over the largest on a ghost."""


@dataclass(frozen=True)
class Atoms:
    """The user's atoms, all on one rank.

    Attributes
    ----------
    script : str
        What made them, for messages.
    x : ndarray, shape ``(n, d)``
    kinds : ndarray of int, shape ``(n,)``
        Types.
    off : OffTypes
        Their potential.
    cutoff : float
        Its range (length).
    """

    script: str
    x: Floats
    kinds: Ints
    off: OffTypes
    cutoff: float


def atoms_of(script: str, engine: Engine, cutoff: float, folder: Path) -> Atoms:
    """Make the potential of a script's atoms anew, so that sites can be switched off.

    Raises
    ------
    BackendError
        See `double_types`.
    """
    off = double_types(script, engine, folder)
    x, kinds = engine.vectors("x").copy(), engine.atoms("type").copy()
    return Atoms(script, x, kinds, off, cutoff)


def find(
    case: Case, atoms: Atoms, comm: Any, folder: Path
) -> tuple[Planes | tuple[Planes, ...], Sites]:
    """Place the planes of all MD regions, and measure what acts there.

    Parameters
    ----------
    comm : mpi4py communicator
        Of one rank.
    folder : Path
        For the files of LAMMPS.

    Raises
    ------
    BackendError
        The atoms do not suit the scheme; the message says where, and gives a way out.
    """
    grid, regions = background_grid(case.domain, finest_cell(case)), zones_of(case).regions
    crystal = crystal_near(case, atoms, regions[0])
    period = _period(crystal, grid, atoms.script)
    interfaces = []
    for key, region in zip(case.atoms.boxes(), regions, strict=True):
        first, second = place(case, crystal, key, region, atoms.script, atoms.cutoff)
        interfaces.append(Interface(first, region.box, second, period))
    strains = unit_strains(case.dim)
    gradients = [0.0 * strains[0], *(s * STRAIN * H for H in strains for s in (1.0, -1.0))]
    with _periodic(case, crystal, period, atoms.off, comm, folder) as (cell, inside):
        deformed = [np.eye(case.dim) + H for H in gradients]
        stresses = np.array([stress(cell, F) for F in deformed])
        apart = np.array([inner_shifts(cell, crystal, inside, F) for F in deformed])
    shift = _derivatives(apart).swapaxes(0, 1)
    shift[np.abs(shift) < NO_SHIFT * np.linalg.norm(crystal.vectors[0])] = 0.0
    kappa = inner_shift.tensors(shift)
    nodal = np.zeros((len(gradients), grid.size, case.dim))
    surface = np.zeros((1, grid.size, case.dim))
    touched = np.zeros(grid.size, dtype=np.bool_)
    for interface in interfaces:
        sites = _sites_near(case, crystal, interface, atoms.cutoff)
        _check_occupied(case, atoms, crystal, interface, sites)
        moved = [sites.x @ F.T + u[sites.member] for F, u in zip(deformed, apart, strict=True)]
        found = _forces(case, atoms, crystal, interface, sites, moved, comm, folder)
        touched |= _add_to_nodes(case, grid, interface, sites, kappa, found, nodal)
        if case.dim == 3 and _ends_at_face(case, sites.x):
            added = _surface_forces(case, atoms, crystal, interface, sites, found[0], comm, folder)
            _add_to_nodes(case, grid, interface, sites, kappa, added[None], surface)
    units, nodes = UNITS[case.units], np.flatnonzero(touched)
    planes = tuple(_by_face(interface.planes) for interface in interfaces)
    measured = Sites(
        vectors=tuple(map(tuple, crystal.vectors.tolist())),
        origin=tuple(crystal.origin.tolist()),
        basis=tuple(map(tuple, crystal.basis.tolist())),
        shift=_bytes(shift),
        period=period,
        layers=tuple(layer(crystal, axis) for axis in range(case.dim)),
        second=tuple(_by_face(interface.second or ()) for interface in interfaces),
        nodes=tuple(nodes.tolist()),
        force=_with_derivatives(nodal[:, nodes] * units.force_to_mechanical(1.0)),
        stress=_with_derivatives(stresses * units.stress_to_mechanical(1.0)),
        surface=_bytes(surface[0, nodes] * units.force_to_mechanical(1.0))
        if surface.any()
        else b"",
    )
    return planes if case.atoms.regions else planes[0], measured


def _with_derivatives(values: Floats) -> bytes:
    """Values at rest, and their derivatives in each strain, from those of all deformations."""
    return _bytes(np.concatenate([values[:1], _derivatives(values)]))


def _derivatives(values: Floats) -> Floats:
    """Central differences in each strain, from values at all deformations."""
    return np.asarray((values[1::2] - values[2::2]) / (2.0 * STRAIN))


def _bytes(values: Floats) -> bytes:
    return values.astype("<f8").tobytes()


def crystal_near(case: Case, atoms: Atoms, region: MdRegion) -> Crystal:
    """The crystal below the middle of the first interface."""
    axis, side = next((a, s) for a in range(case.dim) for s in range(2) if region.interfaces[a][s])
    depth = DEPTH * atoms.cutoff
    middle = np.array([0.5 * (low + high) for low, high in region.box])
    middle[axis] = region.box[axis][side] + (depth if side == 0 else -depth)
    x, kinds = _around(case, atoms, middle, depth)
    if len(x) < 2:
        raise BackendError(f"{atoms.script}: makes no atoms near {where(middle)}; {WAY_OUT}")
    try:
        crystal = recognise(x, kinds)
    except BackendError as error:
        raise BackendError(f"{atoms.script}: {error}; {WAY_OUT}") from None
    if len(crystal.basis) > 1 and case.coupling.absorber is not None:
        raise BackendError(
            f"{atoms.script}: the crystal has {len(crystal.basis)} atoms in its primitive cell; "
            "coupling.absorber would damp their motion against each other: leave it out"
        )
    return crystal


def _around(case: Case, atoms: Atoms, middle: Floats, radius: float) -> tuple[Floats, Ints]:
    """Positions and types of the atoms around a place, and of their images over periodic axes."""
    x, kinds = atoms.x, atoms.kinds
    for axis, (low, high) in enumerate(case.domain.box):
        if case.domain.periodic[axis]:
            most = math.ceil(radius / (high - low))
            shifts = np.arange(-most, most + 1)[:, None] * (high - low) * np.eye(case.dim)[axis]
            x = (shifts[:, None] + x).reshape(-1, case.dim)
            kinds = np.tile(kinds, len(shifts))
        close = np.abs(x[:, axis] - middle[axis]) < radius
        x, kinds = x[close], kinds[close]
    close = np.linalg.norm(x - middle, axis=1) < radius
    return x[close], kinds[close]


def _period(crystal: Crystal, grid: BackgroundGrid, script: str) -> tuple[float, ...]:
    """Shortest translations along the axes."""
    found = []
    for axis in range(grid.dim):
        period = crystal.period(axis)
        if period is None:
            raise BackendError(
                f"{script}: the crystal does not repeat along {'xyz'[axis]}; turn it, or {WAY_OUT}"
            )
        if period > grid.cell * (1.0 + 1e-9):
            raise BackendError(
                f"{script}: the crystal repeats after {period:g} along {'xyz'[axis]}, but "
                f"grid.cell is {grid.cell:g} on the finest level; use cells of at least {period:g}"
            )
        found.append(period)
    return tuple(found)


def _by_face(box: Box) -> Planes:
    """Finite ends of a box by the names of the faces."""
    ends = [end for pair in box for end in pair]
    return Planes(**{FACES[k]: end for k, end in enumerate(ends) if np.isfinite(end)})


def _sites_near(case: Case, crystal: Crystal, interface: Interface, cutoff: float) -> CrystalSites:
    """Sites of ghosts, and of the free atoms near them; continued where the body goes on."""
    sites = sites_of(case, crystal, interface, cutoff, DEPTH * cutoff)
    return sites.take(interface.depth(sites.x) < DEPTH * cutoff)


def sites_of(
    case: Case, crystal: Crystal, interface: Interface, cutoff: float, beyond: float
) -> CrystalSites:
    """Sites of free atoms and ghosts, and beyond the ends of the body where there is no plane."""
    box = []
    for (low, high), (start, end) in zip(interface.second or (), case.domain.box, strict=True):
        box.append(
            (
                low - cutoff if np.isfinite(low) else start - beyond,
                high + cutoff if np.isfinite(high) else end + beyond,
            )
        )
    return crystal.sites(tuple(box))


def in_body(case: Case, x: Floats, slack: float) -> Bools:
    """Which positions lie in the body; along periodic axes it is half-open."""
    inside = _within_faces(case, x, slack)
    for axis, (low, high) in enumerate(case.domain.box):
        if case.domain.periodic[axis]:
            inside &= (x[:, axis] >= low - slack) & (x[:, axis] < high - slack)
    return inside


def _within_faces(case: Case, x: Floats, slack: float) -> Bools:
    """Which positions lie within the faces of the body; it has none along periodic axes."""
    within = np.ones(len(x), dtype=np.bool_)
    for axis, (low, high) in enumerate(case.domain.box):
        if not case.domain.periodic[axis]:
            within &= (x[:, axis] >= low - slack) & (x[:, axis] < high + slack)
    return within


def _ends_at_face(case: Case, sites: Floats) -> bool:
    """Whether some sites near the planes lie beyond a face of the body."""
    return not _within_faces(case, sites, 0.0).all()


def _check_occupied(
    case: Case, atoms: Atoms, crystal: Crystal, interface: Interface, sites: CrystalSites
) -> None:
    """Check that near the planes every site holds an atom, and every atom is at a site."""
    slack = SAME * float(np.linalg.norm(crystal.vectors[0]))
    low, high = np.array(interface.region).T
    here = ((atoms.x > low - slack) & (atoms.x < high + slack)).all(axis=1)
    x, kinds = _wrapped(case, atoms.x[here], slack), atoms.kinds[here]
    near = in_body(case, sites.x, slack) & (interface.depth(sites.x) < PERFECT * atoms.cutoff)
    near &= ((sites.x > low - slack) & (sites.x < high + slack)).all(axis=1)
    needed, wanted = sites.x[near], crystal.kinds[sites.member[near]]
    distance, partner = cKDTree(x).query(needed)
    bad = (distance > slack) | (kinds[partner] != wanted)
    if bad.any():
        raise BackendError(
            f"{atoms.script}: no atom of type {wanted[bad][0]} at {where(needed[bad][0])}, a "
            f"site of the crystal near the planes between atoms and continuum ({bad.sum()} such "
            f"sites), where the sites scheme needs a perfect crystal; {WAY_OUT}"
        )
    inner = PERFECT * atoms.cutoff - 2.0 * slack
    around = (interface.depth(x) < inner) & ~_beyond(interface, x, atoms.cutoff - 2.0 * slack)
    stray = around & (cKDTree(needed).query(x)[0] > slack)
    if stray.any():
        raise BackendError(
            f"{atoms.script}: the atom at {where(x[stray][0])}, near the planes between atoms and "
            f"continuum, is at no site of the crystal ({stray.sum()} such atoms); {WAY_OUT}"
        )


def _beyond(interface: Interface, x: Floats, width: float) -> Bools:
    """Which positions are farther than a width outside the second planes, along any axis."""
    outside = np.zeros(len(x), dtype=np.bool_)
    for axis, (low, high) in enumerate(interface.second or ()):
        outside |= (x[:, axis] < low - width) | (x[:, axis] > high + width)
    return outside


def _wrapped(case: Case, x: Floats, slack: float) -> Floats:
    """Move positions at the upper end of a periodic axis to its lower end."""
    x = x.copy()
    for axis, (low, high) in enumerate(case.domain.box):
        if case.domain.periodic[axis]:
            x[:, axis] = low + (x[:, axis] - low + slack) % (high - low) - slack
    return x


def _forces(
    case: Case,
    atoms: Atoms,
    crystal: Crystal,
    interface: Interface,
    sites: CrystalSites,
    moved: Sequence[Floats],
    comm: Any,
    folder: Path,
) -> Floats:
    """Forces on the atoms near the planes, shape ``(deformations, n, d)``."""
    x, kinds, off = sites.x, crystal.kinds[sites.member], interface.off(sites.x)
    potential, types = atoms.off.potential, atoms.off.types
    found = forces(potential, case.units, x, kinds, types, off, moved, comm, folder)
    depth = interface.depth(x)
    free = (depth > 0.0) & (depth < atoms.cutoff) & in_body(case, x, 0.0)
    largest = float(np.abs(found[:, depth <= 0.0]).max())
    left = float(np.abs(found[:, free]).max(initial=0.0))
    if left > UNBALANCED * largest:
        raise BackendError(
            f"{atoms.script}: forces of {left / largest:.1e} of those on ghosts are left on free "
            f"atoms of the strained crystal; sites of this potential cannot be switched off; "
            f"{WAY_OUT}"
        )
    return found


def _surface_forces(
    case: Case,
    atoms: Atoms,
    crystal: Crystal,
    interface: Interface,
    sites: CrystalSites,
    continued: Floats,
    comm: Any,
    folder: Path,
) -> Floats:
    """What forces at rest change where the crystal ends at faces of the body, shape ``(n, d)``.

    The free atoms relax, as they do in a run, and ghosts stay where the nodes hold them.

    Parameters
    ----------
    continued : ndarray, shape ``(n, d)``
        Forces at rest of the crystal that goes on beyond the faces.
    """
    slack = SAME * float(np.linalg.norm(crystal.vectors[0]))
    x, member = sites_of(case, crystal, interface, atoms.cutoff, slack)
    inside = in_body(case, x, slack)
    x, member = x[inside], member[inside]
    loose = interface.depth(x) > 0.0
    box = zip(case.domain.box, case.domain.periodic, strict=True)
    (real,) = forces(
        atoms.off.potential,
        case.units,
        x,
        crystal.kinds[member],
        atoms.off.types,
        interface.off(x),
        [x],
        comm,
        folder,
        Relaxed(
            loose,
            tuple(ends if periodic else None for ends, periodic in box),
            SURFACE_RELAXED * float(np.abs(continued).max()),
        ),
    )
    ghosts = (interface.depth(sites.x) <= 0.0) & in_body(case, sites.x, slack)
    change = np.zeros_like(sites.x)
    change[ghosts] = real[~loose] - continued[ghosts]
    return change


def _add_to_nodes(
    case: Case,
    grid: BackgroundGrid,
    interface: Interface,
    sites: CrystalSites,
    kappa: Floats,
    found: Floats,
    nodal: Floats,
) -> Bools:
    """Add the forces on ghosts to the nodes that move them; which nodes these are."""
    counted = (interface.depth(sites.x) <= 0.0) & in_body(case, sites.x, 1e-6 * grid.cell)
    t = in_cells(grid, sites.x[counted])
    half = np.tile(interface.half_widths(grid), (len(t), 1))
    nodes, S, dS = gimp_stencils(t, half, grid.cell, window_of(grid))
    slopes, of_sites = np.ascontiguousarray(np.moveaxis(dS, 2, 0)), kappa[sites.member[counted]]
    for force, sums in zip(found[:, counted], nodal, strict=True):
        particles_to_grid(nodes, S, np.ascontiguousarray(force), sums)
        for axis, couple in enumerate(np.moveaxis(inner_shift.couples(of_sites, force), 2, 0)):
            particles_to_grid(nodes, slopes[axis], np.ascontiguousarray(couple), sums)
    touched = np.zeros(grid.size, dtype=np.bool_)
    touched[nodes[S > NO_WEIGHT]] = True
    return touched


@contextmanager
def _periodic(
    case: Case,
    crystal: Crystal,
    period: tuple[float, ...],
    off: OffTypes,
    comm: Any,
    folder: Path,
) -> Iterator[tuple[Cell, CrystalSites]]:
    """A periodic cell of the crystal, its atoms by id, all on; LAMMPS is closed at the end."""
    dim, slack = case.dim, SAME * min(period)
    box = tuple(
        (low - slack, low + length - slack)
        for low, length in zip(crystal.origin.tolist(), period, strict=True)
    )
    sites = crystal.sites(box)
    x = np.zeros((len(sites.x), 3))
    x[:, :dim] = sites.x
    ends = [f"{low:.17g} {high:.17g}" for low, high in box]
    engine = Engine(comm, folder / "log.periodic")
    try:
        engine.commands(
            [
                *unit_style(case.units),
                f"dimension {dim}",
                "boundary p p p",
                f"region box block {' '.join([*ends, '-0.5 0.5'][:3])} units box",
                f"create_box {2 * off.types} box",
            ]
        )
        kinds = crystal.kinds[sites.member].tolist()
        ids = list(range(1, len(x) + 1))
        engine.lammps.create_atoms(len(x), ids, kinds, x.ravel().tolist())
        engine.commands([*off.potential.commands(), "mass * 1.0"])
        yield settled(cell_of("the crystal near the planes", engine), RELAXED), sites
    finally:
        engine.close()

"""The atoms that the user describes, in the box that a calculator sees."""

from __future__ import annotations

import math

import ase
import ase.io
import numpy as np

from gimpmd_md.engines.ase.input import Crystal, Input
from gimpmd_schemas.arrays import Bools, Floats
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.zones import Box

SLACK = 1e-6
"""How far atoms may lie outside their boxes, in cells of the grid."""


def make_structure(plan: Plan, given: Input, cutoff: float) -> ase.Atoms:
    """Make the atoms at their lattice positions.

    Positions are those of the body. The cell of the result is that of the domain along periodic
    axes. Along the others its length has no meaning, but some calculators need one: the atoms have
    a cutoff of room on each side.

    Parameters
    ----------
    plan : Plan
    given : Input
        Its files are in the working directory.
    cutoff : float
        Range of the potential (length).

    Raises
    ------
    BackendError
        There are no atoms, some lie outside the MD regions, or the structure has another period
        than the domain.
    """
    name = plan.atoms.input
    slack = SLACK * plan.finest_cell
    if given.crystal is not None:
        atoms = _filled(given.crystal, plan, slack)
    else:
        atoms = _read(name, str(given.structure))
    if not len(atoms):
        raise BackendError(f"{name}: makes no atoms in md.region {plan.atoms.region}")
    x = atoms.positions[:, : plan.dim]
    strays = x[~_inside(x, plan.atoms.regions, slack)]
    if len(strays):
        place = ", ".join(f"{c:.6g}" for c in strays[0])
        raise BackendError(
            f"{name}: the atom at ({place}) lies outside md.region ({len(strays)} such atoms); "
            "give the atoms of the region only, at their positions in the body"
        )
    _set_masses(name, atoms, given.masses)
    _set_cell(name, atoms, plan, cutoff)
    return atoms


def _filled(crystal: Crystal, plan: Plan, slack: float) -> ase.Atoms:
    """A crystal in all MD regions; on a periodic axis the upper face is an image of the lower."""
    dim, edges = plan.dim, np.array(crystal.cell)
    origin = np.array(crystal.origin or (0.0,) * len(edges))
    counts = [
        np.arange(math.floor((low - o) / edge) - 1, math.ceil((high - o) / edge) + 1)
        for (low, high), o, edge in zip(plan.atoms.region, origin, edges, strict=False)
    ]
    cells = np.zeros((math.prod(map(len, counts)), len(edges)))
    cells[:, :dim] = np.stack(np.meshgrid(*counts, indexing="ij"), axis=-1).reshape(-1, dim)
    x = (origin + (cells[:, None] + np.array(crystal.sites)) * edges).reshape(-1, len(edges))
    kept = _inside(x[:, :dim], plan.atoms.regions, slack)
    for axis in np.flatnonzero(plan.domain.periodic):
        kept &= x[:, axis] < plan.atoms.region[axis][1] - slack
    positions = np.zeros((np.count_nonzero(kept), 3))
    positions[:, : len(edges)] = x[kept]
    species = np.tile(crystal.species, len(cells))[kept]
    depth = edges[2] if len(edges) > dim else 0.0
    return ase.Atoms(species.tolist(), positions, cell=[0, 0, depth], pbc=[0, 0, depth > 0.0])


def _read(name: str, file: str) -> ase.Atoms:
    try:
        found = ase.io.read(file)
    except Exception as error:  # ase.io raises errors of all kinds
        raise BackendError(
            f"{name}: structure = {file!r}: ase.io cannot read it: {error}; is it beside the case "
            "and named in md.files?"
        ) from error
    if not isinstance(found, ase.Atoms):
        raise BackendError(f"{name}: structure = {file!r} must hold one structure")
    return found


def _inside(x: Floats, boxes: tuple[Box, ...], slack: float) -> Bools:
    low, high = np.array(boxes).transpose(2, 0, 1)
    within = (x[:, None] >= low - slack) & (x[:, None] <= high + slack)
    return np.asarray(within.all(axis=2).any(axis=1))


def _set_masses(name: str, atoms: ase.Atoms, masses: dict[str, float]) -> None:
    symbols = np.array(atoms.get_chemical_symbols())
    mass = atoms.get_masses()
    for species, value in masses.items():
        if species not in symbols:
            raise BackendError(
                f"{name}: masses.{species}: there is no such atom; there are "
                f"{', '.join(sorted(set(symbols.tolist())))}"
            )
        mass[symbols == species] = value
    atoms.set_masses(mass)


def _set_cell(name: str, atoms: ase.Atoms, plan: Plan, cutoff: float) -> None:
    lengths, periodic = atoms.cell.lengths(), np.array(atoms.pbc)
    if not np.allclose(atoms.cell, np.diag(np.diag(atoms.cell))):
        raise BackendError(f"{name}: the cell of the atoms must be a box along the axes")
    for axis in range(plan.dim):
        low, high = plan.domain.box[axis]
        given = periodic[axis] and lengths[axis] > 0.0
        if plan.domain.periodic[axis]:
            if given and abs(lengths[axis] - (high - low)) > 1e-6 * (high - low):
                raise BackendError(
                    f"{name}: the atoms have a period of {lengths[axis]:.9g} along "
                    f"{'xyz'[axis]}, but the domain one of {high - low:.9g}; make them equal"
                )
            lengths[axis] = high - low
        elif given:
            raise BackendError(
                f"{name}: the atoms are periodic along {'xyz'[axis]}, but the domain is not; set "
                "the pbc of the structure"
            )
        periodic[axis] = plan.domain.periodic[axis]
    x = atoms.positions
    room = np.ptp(x, axis=0) + 2.0 * cutoff
    atoms.set_cell(np.where(periodic, lengths, room))
    atoms.set_pbc(periodic)

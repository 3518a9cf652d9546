"""A crystal of embedded atoms, one in the primitive cell: neighbours and LAMMPS's own tables."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from gimpmd_md.crystal.cell import Cell
from gimpmd_md.crystal.recognise import Crystal, recognise
from gimpmd_md.engines.lammps.library import text_of
from gimpmd_md.engines.lammps.site_off.commands import potential_in
from gimpmd_md.engines.lammps.site_off.double import tables_of
from gimpmd_md.engines.lammps.site_off.setfl import Tables
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.materials import Anisotropic, EmbeddedLattice
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.mechanics.splines import cubics, interpolate
from gimpmd_schemas.mechanics.units import UNITS

REACH = 1.12
"""Distance of the farthest neighbours, in cutoffs: compression by a strain of 0.1 brings them
within the cutoff."""

SAMPLES = (1.0, 1.004, 0.99)
"""Factors of all lengths at which the energy of the sum is compared with LAMMPS's."""

SAME_ENERGY = 1e-10
"""Relative difference of energies that is round-off."""


def of_cell(cell: Cell, linear: Anisotropic) -> EmbeddedLattice:
    """The material of a cell whose energy is the exact sum over neighbours.

    Parameters
    ----------
    linear : Anisotropic
        What was measured of it at small strains.

    Raises
    ------
    BackendError
        The atoms have another potential, or form no crystal with one atom per primitive cell.
    """
    crystal, tables = _crystal(cell), _tables(cell)
    bonds = half_star(crystal.vectors, REACH * tables.cutoff)
    _check(cell, tables, bonds)
    return EmbeddedLattice(
        density=linear.density,
        stiffness=linear.stiffness,
        volume=crystal.volume,
        bonds=tuple(tuple(bond) for bond in bonds.tolist()),
        cutoff=tables.cutoff,
        distance_step=tables.dr,
        density_step=tables.drho,
        pair=_bytes(tables.z[0, 0]),
        cloud=_bytes(tables.rho[0]),
        embedding=_bytes(tables.F[0]),
    )


def half_star(vectors: Floats, reach: float) -> Floats:
    """Vectors to the neighbours of a site within a distance, one of each opposite pair, ``(m, 3)``.

    Parameters
    ----------
    vectors : ndarray, shape ``(3, 3)``
        Primitive vectors.
    """
    most = np.floor(reach * np.linalg.norm(np.linalg.inv(vectors), axis=0)).astype(int)
    n = np.array([m for m in product(*(range(-k, k + 1) for k in most)) if m > (0, 0, 0)])
    R = n @ vectors
    length = np.linalg.norm(R, axis=1)
    order = np.argsort(length, kind="stable")
    return np.asarray(R[order[length[order] < reach]])


def energy(tables: Tables, bonds: Floats) -> float:
    """Energy of an atom with these neighbours, one of each opposite pair."""
    r = np.linalg.norm(bonds, axis=1)
    r = r[r < tables.cutoff]
    cloud = tables.rho[0]
    around = 2.0 * interpolate(cubics(cloud), tables.dr, r).sum()
    deep = interpolate(cubics(tables.F[0]), tables.drho, np.array(around))
    return float(deep + (interpolate(cubics(tables.z[0, 0]), tables.dr, r) / r).sum())


def _crystal(cell: Cell) -> Crystal:
    engine = cell.engine
    cell.deform(np.eye(3))
    x, kinds, shifts = engine.vectors("x").copy(), engine.atoms("type").copy(), cell.images()
    try:
        crystal = recognise((x + shifts[:, None]).reshape(-1, 3), np.tile(kinds, len(shifts)))
    except BackendError as error:
        raise BackendError(f"{cell.script}: model: lattice-sum: {error}") from None
    if len(crystal.basis) > 1:
        raise BackendError(
            f"{cell.script}: the crystal has {len(crystal.basis)} atoms in its primitive cell, and "
            "model: lattice-sum is for one; use model: cauchy-born"
        )
    return crystal


def _tables(cell: Cell) -> Tables:
    """Tables of the only element in the cell."""
    engine = cell.engine
    types = int(engine.lammps.extract_setting("ntypes"))
    tables = tables_of(potential_in(text_of(engine.log)), types)
    if tables is None:
        raise BackendError(
            f"{cell.script}: model: lattice-sum is for pair_style eam, eam/alloy and eam/fs; use "
            "model: cauchy-born"
        )
    kind = int(engine.atoms("type")[0]) - 1
    rho = tables.rho[kind] if tables.rho.ndim == 2 else tables.rho[kind, kind]
    return replace(
        tables,
        names=(tables.names[kind],),
        heads=(tables.heads[kind],),
        F=tables.F[[kind]],
        rho=rho[None],
        z=tables.z[kind : kind + 1, kind : kind + 1],
    )


def _check(cell: Cell, tables: Tables, bonds: Floats) -> None:
    """Compare the energy with LAMMPS's own, so that nothing is left out."""
    nktv2p = UNITS[str(cell.engine.lammps.extract_global("units"))].nktv2p
    per_atom = float(np.linalg.det(cell.box)) / cell.engine.lammps.get_natoms() / nktv2p
    for factor in SAMPLES:
        exact = cell.deform(factor * np.eye(3))[0] * per_atom
        found = energy(tables, factor * bonds)
        if abs(found - exact) > SAME_ENERGY * abs(exact):
            raise BackendError(
                f"{cell.script}: the sum over the neighbours of an atom gives an energy of "
                f"{found:.12g}, and LAMMPS {exact:.12g}: the atoms have another potential besides, "
                "or the file has other units; use model: cauchy-born"
            )
    cell.deform(np.eye(3))


def _bytes(values: Floats) -> bytes:
    return values.astype("<f8").tobytes()

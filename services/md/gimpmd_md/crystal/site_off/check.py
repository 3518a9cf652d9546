"""Check of a potential with sites that are off against the whole crystal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimpmd_md.crystal.cell import Cell
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.errors import BackendError

ROUND_OFF = 1e-9
"""Largest accepted disagreement, over the energy of a site and over force scales.

LAMMPS evaluates tables and three-body terms to about 1e-12 of the energy.
"""


@dataclass(frozen=True)
class Agreement:
    """How far energy and forces are from those of the whole crystal.

    Attributes
    ----------
    energy : float
        Energy of the sites that are on, over their number times the energy of a site, minus 1.
    force : float
        Largest difference of a force on a free atom, times the spacing, over the energy of a site.
    free : int
        Number of atoms all of whose neighbours are on.
    """

    energy: float
    force: float
    free: int


def agreement(cell: Cell, off: Ints, types: int, F: Floats) -> Agreement:
    """Switch off sites of a strained periodic crystal, and compare it with the whole crystal.

    All sites must be equivalent or, if they are not, off in the same proportions. Afterwards all
    sites are on.

    Parameters
    ----------
    cell : Cell
        A periodic crystal with the potential of `double.with_off_sites`, all sites on, on one rank.
    off : ndarray of int
        Ids of the atoms whose sites are switched off.
    types : int
        Number of types of sites that are on.
    F : ndarray, shape ``(d, d)``
        Deformation gradient, upper triangular.
    """
    engine, dim = cell.engine, len(cell.box)
    cell.deform(F)
    whole, forces = engine.thermo("pe"), engine.vectors_by_id("f")
    kind = engine.atoms("type")
    chosen = np.isin(engine.atoms("id"), off)
    kind[chosen] += types
    engine.commands(["run 0 post no"])
    part, found = engine.thermo("pe"), engine.vectors_by_id("f")
    free = _free(cell, F, off)
    kind = engine.atoms("type")
    kind[kind > types] -= types
    n = len(kind)
    spacing = float(np.linalg.det(cell.box) / n) ** (1.0 / dim)
    site = abs(whole) / n
    return Agreement(
        energy=part / (whole * (n - len(off)) / n) - 1.0,
        force=float(np.abs(found - forces)[free].max(initial=0.0)) * spacing / site,
        free=int(free.sum()),
    )


def check(cell: Cell, off: Ints, types: int, strains: list[Floats]) -> None:
    """Raise `BackendError` unless energies and forces agree at all deformations.

    The arguments are those of `agreement`.
    """
    for F in strains:
        found = agreement(cell, off, types, F)
        if found.free == 0:
            raise ValueError("no atom has only neighbours that are on")
        if max(abs(found.energy), found.force) > ROUND_OFF:
            raise BackendError(
                f"{cell.script}: the sites of this potential cannot be switched off: their energy "
                f"is off by {found.energy:.1e}, the forces on free atoms by {found.force:.1e}; "
                "use coupling.scheme: velocity"
            )


def _free(cell: Cell, F: Floats, off: Ints) -> Bools:
    """Which atoms, in the order of their ids, have no neighbour that is off, nor are off."""
    x, edges = cell.engine.vectors_by_id("x"), F @ cell.box
    gone = np.isin(np.sort(cell.engine.atoms("id")), off)
    reach = cell.engine.pair_cutoff()
    free = ~gone
    for site in x[gone]:
        away = (x - site) @ np.linalg.inv(edges).T
        away = (away - np.round(away)) @ edges.T
        free &= np.linalg.norm(away, axis=1) > reach
    return free

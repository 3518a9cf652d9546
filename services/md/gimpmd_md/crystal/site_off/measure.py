"""Forces and stresses of a strained crystal with sites that are off, measured by LAMMPS.

They give the residual of scheme FS at the planes for any potential whose sites can be switched off,
without any formula for its energy.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gimpmd_md.crystal.cell import Cell
from gimpmd_md.engines.lammps.library import Engine
from gimpmd_md.engines.lammps.site_off.commands import Potential
from gimpmd_schemas.arrays import Bools, Floats, Ints

MARGIN = 1.0
"""Space around a cluster of atoms, over its extent; LAMMPS shrinks the box to the atoms."""


def forces(
    potential: Potential,
    units: str,
    x: Floats,
    kinds: Ints,
    types: int,
    off: Bools,
    strains: Sequence[Floats],
    comm: Any,
    folder: Path,
) -> Floats:
    """Forces on the atoms of a cluster, uniformly strained.

    Parameters
    ----------
    potential : Potential
        Of `double.with_off_sites`.
    units : str
        Unit style.
    x : ndarray, shape ``(n, d)``
        Lattice sites (length).
    kinds : ndarray of int, shape ``(n,)``
        Types of the atoms, from 1 on, as if all sites were on.
    types : int
        How many types the potential is made for.
    off : ndarray of bool, shape ``(n,)``
        Sites that are off.
    strains : sequence of ndarray, shape ``(d, d)``
        Deformation gradients.
    comm : mpi4py communicator
        Of one rank.
    folder : Path
        For LAMMPS's log.

    Returns
    -------
    ndarray, shape ``(m, n, d)``
        Minus the derivatives of the energy of the sites that are on (force).
    """
    dim = x.shape[1]
    low, high = x.min(axis=0), x.max(axis=0)
    reach = MARGIN * (high - low).max()
    ends = [f"{a - reach:.17g} {b + reach:.17g}" for a, b in zip(low, high, strict=True)]
    places = np.zeros((len(x), 3))
    places[:, :dim] = x
    engine = Engine(comm, folder / "log.forces")
    try:
        engine.commands(
            [
                f"units {units}",
                f"dimension {dim}",
                f"boundary {' '.join('ssp' if dim == 2 else 'sss')}",
                f"region box block {' '.join([*ends, '-0.5 0.5'][:3])} units box",
                f"create_box {2 * types} box",
            ]
        )
        ids = list(range(1, len(x) + 1))
        engine.lammps.create_atoms(
            len(x), ids, (kinds + types * off).tolist(), places.ravel().tolist()
        )
        engine.commands([*potential.commands(), "mass * 1.0"])
        found = np.empty((len(strains), *x.shape))
        for F, at in zip(strains, found, strict=True):
            engine.vectors("x")[np.argsort(engine.atoms("id"))] = x @ F.T
            engine.commands(["run 0 post no"])
            at[:] = engine.vectors("f")[np.argsort(engine.atoms("id"))]
        return found
    finally:
        engine.close()


def stress(cell: Cell, F: Floats) -> Floats:
    """First Piola-Kirchhoff stress of a periodic cell (pressure units), shape ``(d, d)``.

    Parameters
    ----------
    F : ndarray, shape ``(d, d)``
        Any deformation gradient. LAMMPS gets its upper triangular part, without the rotation.
    """
    Q, R = np.linalg.qr(F)
    signs = np.sign(np.diag(R))
    Q, R = Q * signs, signs[:, None] * R
    _, tau = cell.deform(R)
    return np.asarray(Q @ tau @ np.linalg.inv(R).T)

"""Forces, stresses and inner shifts of a strained crystal, measured by LAMMPS.

They give the residual of scheme FS at the planes for any potential whose sites can be switched off,
without any formula for its energy.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gimpmd_md.crystal.cell import Cell, upright
from gimpmd_md.crystal.recognise import Crystal, CrystalSites
from gimpmd_md.engines.lammps.library import Engine, unit_style
from gimpmd_md.engines.lammps.site_off.commands import Potential
from gimpmd_schemas.arrays import Bools, Floats, Ints

MARGIN = 1.0
"""Space around a cluster of atoms, over its extent; LAMMPS shrinks the box to the atoms."""


class Relaxed(NamedTuple):
    """Atoms of a cluster that relax while the others are held.

    Attributes
    ----------
    loose : ndarray of bool, shape ``(n,)``
        Atoms that relax.
    periodic : tuple
        Ends of the box along each axis; None where the cluster has surfaces.
    force : float
        Norm of the forces on atoms at which they count as relaxed (energy / length).
    """

    loose: Bools
    periodic: tuple[tuple[float, float] | None, ...]
    force: float


def forces(
    potential: Potential,
    units: str,
    x: Floats,
    kinds: Ints,
    types: int,
    off: Bools,
    deformed: Sequence[Floats],
    comm: Any,
    folder: Path,
    relaxed: Relaxed | None = None,
) -> Floats:
    """Forces on the atoms of a cluster, at rest and where a strain moves them.

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
    deformed : sequence of ndarray, shape ``(n, d)``
        Positions of the atoms (length).
    comm : mpi4py communicator
        Of one rank.
    folder : Path
        For LAMMPS's log.
    relaxed : Relaxed, optional
        Which atoms relax before forces are read; None: no atoms do.

    Returns
    -------
    ndarray, shape ``(m, n, d)``
        Minus the derivatives of the energy of the sites that are on (force).
    """
    dim = x.shape[1]
    low, high = x.min(axis=0), x.max(axis=0)
    reach = MARGIN * (high - low).max()
    spans = relaxed.periodic if relaxed else (None,) * dim
    ends = [
        f"{a - reach:.17g} {b + reach:.17g}" if span is None else f"{span[0]:.17g} {span[1]:.17g}"
        for a, b, span in zip(low, high, spans, strict=True)
    ]
    edges = ["s" if span is None else "p" for span in spans]
    places = np.zeros((len(x), 3))
    places[:, :dim] = x
    engine = Engine(comm, folder / "log.forces")
    try:
        engine.commands(
            [
                *unit_style(units),
                f"dimension {dim}",
                f"boundary {' '.join([*edges, 'p'][:3])}",
                f"region box block {' '.join([*ends, '-0.5 0.5'][:3])} units box",
                f"create_box {2 * types} box",
            ]
        )
        ids = list(range(1, len(x) + 1))
        engine.lammps.create_atoms(
            len(x), ids, (kinds + types * off).tolist(), places.ravel().tolist()
        )
        engine.commands([*potential.commands(), "mass * 1.0"])
        found = np.empty((len(deformed), *x.shape))
        for moved, at in zip(deformed, found, strict=True):
            engine.vectors("x")[np.argsort(engine.atoms("id"))] = moved
            engine.commands([] if relaxed is None else _relaxing(relaxed))
            engine.commands(["run 0 post no"])
            at[:] = engine.vectors_by_id("f")
        return found
    finally:
        engine.close()


def _relaxing(relaxed: Relaxed) -> list[str]:
    """Commands that relax some atoms, numbered from 1 on, and hold the others."""
    ends = np.concatenate([[True], relaxed.loose, [True]])
    steps = np.flatnonzero(np.diff(ends.astype(int)))
    held = " ".join(f"{first + 1}:{last}" for first, last in steps.reshape(-1, 2).tolist())
    return [
        f"group held id {held}",
        "fix held held setforce 0.0 0.0 0.0",
        f"minimize 0.0 {relaxed.force:g} 100000 1000000",
        "unfix held",
        "group held delete",
    ]


def stress(cell: Cell, F: Floats) -> Floats:
    """First Piola-Kirchhoff stress of a periodic cell (pressure units), shape ``(d, d)``.

    Parameters
    ----------
    F : ndarray, shape ``(d, d)``
        Any deformation gradient. LAMMPS gets its upper triangular part, without the rotation.
    """
    Q, R = upright(F)
    _, tau = cell.deform(R)
    return np.asarray(Q @ tau @ np.linalg.inv(R).T)


def inner_shifts(cell: Cell, crystal: Crystal, sites: CrystalSites, F: Floats) -> Floats:
    """How far the atoms of a primitive cell are from where F takes their sites, shape ``(b, d)``.

    The mean over the atoms is zero.

    Parameters
    ----------
    cell : Cell
        A periodic crystal whose atoms relax, if need be, when it is deformed.
    sites : CrystalSites
        Sites of its atoms, in the order of their ids.
    F : ndarray, shape ``(d, d)``
        Any deformation gradient.
    """
    Q, R = upright(F)
    cell.deform(R)
    low, edges = np.array(cell.low), R @ cell.box
    x = cell.engine.vectors_by_id("x")
    away = (x - low) - (sites.x - low) @ R.T
    away -= np.rint(away @ np.linalg.inv(edges).T) @ edges.T
    found = np.zeros(crystal.basis.shape)
    np.add.at(found, sites.member, away)
    found *= len(found) / len(away)
    return np.asarray((found - found.mean(axis=0)) @ Q.T)

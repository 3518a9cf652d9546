"""Stress that the atoms carry at rest where the material points take their motion from them.

A material point is free of stress at rest. The atoms near it are not if a free surface, such as
that of a hole, or another defect is near: the surface pulls on the crystal around it. The stress of
the points then lacks this stress of the atoms. In the velocity schemes nothing else shows it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gimpmd_md.roles import BOUNDARY, PROJECTED
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.mechanics.units import UNITS

NOTICEABLE = 5e-4
"""Smallest mean stress of a cell that is worth a word, over C11."""


@dataclass(frozen=True)
class AtRest:
    """Atoms of a rank at rest.

    Attributes
    ----------
    cutoff : float
        Range of the potential (length).
    role : ndarray of int, shape ``(n,)``
    site : ndarray, shape ``(n, d)``
        Lattice positions.
    mass : ndarray, shape ``(n,)``
    stress : ndarray, shape ``(n, c)``
        Components of stress times volume of the atom (pressure times area or volume).
    """

    cutoff: float
    role: Ints
    site: Floats
    mass: Floats
    stress: Floats


def note_at_rest(plan: Plan, atoms: AtRest, comm: Any) -> tuple[str, ...]:
    """Say so if the projected atoms carry a stress at rest; collective.

    Parameters
    ----------
    plan : Plan
        Of a run by one of the velocity schemes.
    atoms : AtRest
        Those of this rank.
    comm : mpi4py communicator

    Returns
    -------
    tuple of str
        No sentence, or one.
    """
    seen = ((atoms.role & PROJECTED) != 0) & ((atoms.role & BOUNDARY) == 0)
    seen &= _inside(plan, 2.0 * atoms.cutoff, atoms.site)
    volume = atoms.mass[seen] / plan.continuum.material.density
    found = _largest_mean(plan.finest_cell, atoms.site[seen], atoms.stress[seen], volume)
    largest, place = max(comm.allgather(found))
    stiffness = float(plan.stiffness()[0, 0])
    if largest <= NOTICEABLE * stiffness:
        return ()
    where = ", ".join(f"{c:.4g}" for c in place)
    unit = UNITS[plan.units].pressure
    return (
        f"at rest the atoms near ({where}), whose motion the material points take, carry a "
        f"stress of {largest:.3g} {unit} ({largest / stiffness:.1e} of C11) that the points do not "
        "have: a free surface, such as that of a hole, or a defect is near, or the crystal is not "
        "at zero pressure; move the faces of md.region away from it",
    )


def _inside(plan: Plan, depth: float, x: Floats) -> Bools:
    """Which positions lie away from the faces of the body: below these there is no stress."""
    inside = np.ones(len(x), dtype=np.bool_)
    for axis, (low, high) in enumerate(plan.domain.box):
        if not plan.domain.periodic[axis]:
            inside &= (x[:, axis] > low + depth) & (x[:, axis] < high - depth)
    return inside


def _largest_mean(
    cell: float, x: Floats, stress: Floats, volume: Floats
) -> tuple[float, tuple[float, ...]]:
    """Largest component of the mean stress of the atoms in a cell, and the mean of their positions.

    Cells with fewer than half of the usual number of atoms do not count: the edge of what is looked
    at cuts them.
    """
    if not len(x):
        return 0.0, ()
    _, cells, count = np.unique(
        np.floor(x / cell).astype(np.int64), axis=0, return_inverse=True, return_counts=True
    )
    cells = cells.ravel()
    full = count >= 0.5 * count.max()
    total = np.bincount(cells, volume)
    means = np.stack([np.bincount(cells, column) / total for column in stress.T], axis=1)
    largest = np.where(full, np.abs(means).max(axis=1), 0.0)
    worst = int(np.argmax(largest))
    return float(largest[worst]), tuple(x[cells == worst].mean(axis=0).tolist())

"""How the periodic cell of a crystal repeats, so that strips of whole periods can be cut."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from gimpmd_md.crystal.cell import open_cell
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.materials import MeasuredByMd
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.wire.answers import Repeat

SAME_PLACE = 1e-4
"""Atoms closer than this fraction of their spacing are at the same place."""


def repeat_of(case: Case, comm: Any) -> Repeat:
    """Measure the periodic cell that the material of a case names.

    Raises
    ------
    BackendError
        The case names no cell, LAMMPS refuses it, or its box is not upright.
    """
    material = case.continuum.material
    if not isinstance(material, MeasuredByMd):
        raise BackendError("continuum.material names no cell")
    with (
        tempfile.TemporaryDirectory() as folder,
        open_cell(
            material.cell, case.units, comm, Path(folder) / "log.lammps", dims=(case.dim,)
        ) as cell,
    ):
        size = np.diag(cell.box)
        if np.abs(cell.box - np.diag(size)).max() > 1e-9 * size[0]:
            raise BackendError(
                f"{material.cell}: the box of the cell is tilted, but a strip needs an upright "
                "one; write a larger cell of the same crystal (hexagonal: two atoms, a x "
                "sqrt(3) a)"
            )
        cell.deform(np.eye(case.dim))  # as made, or relaxed
        x, kind = cell.engine.vectors("x") - cell.low, cell.engine.atoms("type")
        period = [least_translation(x, kind, size, axis) for axis in range(case.dim)]
    return Repeat(low=tuple(cell.low), size=tuple(size.tolist()), period=tuple(period))


def least_translation(x: Floats, kind: Ints, size: Floats, axis: int) -> float:
    """Find the shortest translation along an axis that maps a periodic cell onto itself.

    Parameters
    ----------
    x : ndarray, shape ``(n, d)``
        Positions relative to the lower corner of the cell.
    kind : ndarray of int, shape ``(n,)``
        Types of the atoms; only atoms of one type map onto each other.
    size : ndarray, shape ``(d,)``
        Edges of the cell.
    """
    n = x.shape[0]
    near = SAME_PLACE * float(np.prod(size) / n) ** (1.0 / size.size)
    # the number of translations divides the number of atoms
    for count in (c for c in range(n, 1, -1) if n % c == 0):
        moved = x.copy()
        moved[:, axis] += size[axis] / count
        distance, partner = cKDTree(x % size, boxsize=size).query(moved % size)
        if distance.max() < near and (kind[partner] == kind).all():
            return float(size[axis]) / count
    return float(size[axis])

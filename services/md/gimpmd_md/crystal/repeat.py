"""How the periodic cell of a crystal repeats: what a strip of the crystal is cut from."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from gimpmd_md.crystal.cell import open_cell
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.form import Case, MeasuredByMd
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.wire.answers import Repeat

SAME_PLACE = 1e-4
"""Atoms closer than this times their spacing are at the same place."""


def repeat_of(case: Case, comm: Any) -> Repeat:
    """Corner, edges and shortest translations along the axes of the cell of a case's material.

    Returns
    -------
    Repeat

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
        open_cell(material.cell, case.units, comm, Path(folder) / "log.lammps") as cell,
    ):
        size = np.diag(cell.box)
        if abs(cell.box[0, 1]) > 1e-9 * size[0]:
            raise BackendError(
                f"{material.cell}: the box of the cell is tilted, but a strip needs an upright "
                "one; write a larger cell of the same crystal (hexagonal: two atoms, a x "
                "sqrt(3) a)"
            )
        cell.deform(np.eye(2))  # as made, or relaxed
        x, kind = cell.engine.vectors("x") - cell.low, cell.engine.atoms("type")
        period = [least_translation(x, kind, size, axis) for axis in range(2)]
    return Repeat(low=cell.low, size=tuple(size.tolist()), period=tuple(period))


def least_translation(x: Floats, kind: Ints, size: Floats, axis: int) -> float:
    """Shortest translation along an axis that maps the atoms of a periodic cell on themselves.

    Parameters
    ----------
    x : ndarray, shape ``(n, 2)``
        Positions from the cell's lower corner.
    kind : ndarray of int, shape ``(n,)``
        Types: atoms of different ones are different.
    size : ndarray, shape ``(2,)``
        Edges of the cell.
    """
    n = x.shape[0]
    near = SAME_PLACE * float(np.sqrt(size[0] * size[1] / n))
    # the atoms fall into classes of as many as there are translations
    for count in (c for c in range(n, 1, -1) if n % c == 0):
        moved = x.copy()
        moved[:, axis] += size[axis] / count
        distance, partner = cKDTree(x % size, boxsize=size).query(moved % size)
        if distance.max() < near and (kind[partner] == kind).all():
            return float(size[axis]) / count
    return float(size[axis])

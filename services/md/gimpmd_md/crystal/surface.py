"""Surface energy of a crystal: a slab is cut from its periodic cell, and relaxed."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from gimpmd_md.crystal.cell import Cell, open_cell
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.materials import MeasuredByMd
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.mechanics.units import UNITS
from gimpmd_schemas.wire.answers import Surfaces

THICKNESS = 4.0
"""Least thickness of the slab, in ranges of the potential, so that its faces do not interact."""

SAME_LAYER = 1e-3
"""Atoms closer than this along the normal lie in one layer, in atom spacings."""


def surfaces_of(case: Case, comm: Any) -> Surfaces:
    """Measure the surface energies of the crystal that the material of a case names.

    Raises
    ------
    BackendError
        The case names no cell, or LAMMPS refuses it.
    """
    material = case.continuum.material
    if not isinstance(material, MeasuredByMd):
        raise BackendError(
            "continuum.material names no cell; write continuum.material: {from: md, cell: ...} "
            "with a periodic cell of the crystal"
        )
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for axis in range(case.dim):
            with open_cell(material.cell, case.units, comm, Path(folder) / "log.lammps") as cell:
                found.append(surface_energy(cell, axis))
    unrelaxed, relaxed = zip(*found, strict=True)
    return Surfaces(unrelaxed=unrelaxed, relaxed=relaxed)


def surface_energy(cell: Cell, axis: int) -> tuple[float, float]:
    """Measure the energy of the surface normal to an axis: as cut, and relaxed.

    The cell is repeated to a slab and cut at the widest gap between two layers of atoms; then the
    box is opened along the axis. The cell cannot be used afterwards.

    Returns
    -------
    unrelaxed, relaxed : float
        Energy per area of each surface, gamma (pressure times length).
    """
    engine, letter = cell.engine, "xyz"[axis]
    dim = len(cell.box)
    cell.deform(np.eye(dim))
    low, high, *_ = engine.lammps.extract_box()
    count = int(np.ceil(THICKNESS * engine.pair_cutoff() / (high[axis] - low[axis])))
    copies = [count if a == axis else 1 for a in range(3)]
    shift = [0.0, 0.0, 0.0]
    shift[axis] = -_gap(cell, axis)
    engine.commands(
        [
            "replicate {} {} {}".format(*copies),
            "displace_atoms all move {:.17g} {:.17g} {:.17g} units box".format(*shift),
            "run 0 post no",  # back into the periodic box
        ]
    )
    bulk = engine.thermo("pe")
    low, high, *_ = engine.lammps.extract_box()
    end = 2.0 * high[axis] - low[axis]
    engine.commands(
        [f"change_box all {letter} final {low[axis]:.17g} {end:.17g} units box", "run 0 post no"]
    )
    # of one face, a length in two dimensions
    area = float(np.linalg.det(cell.box) / cell.box[axis, axis])
    style = str(engine.lammps.extract_global("units"))
    per_face = UNITS[style].nktv2p / (2.0 * area)
    unrelaxed = per_face * (engine.thermo("pe") - bulk)
    engine.commands(["minimize 1e-14 0 10000 100000"])
    return unrelaxed, per_face * (engine.thermo("pe") - bulk)


def _gap(cell: Cell, axis: int) -> float:
    """Height of the middle of the widest gap between layers, above the lower face of the cell."""
    size = float(cell.box[axis, axis])
    x = np.sort((cell.engine.vectors("x")[:, axis] - cell.low[axis]) % size)
    gaps = np.diff(np.append(x, x[0] + size))
    spacing = float(np.linalg.det(cell.box) / x.size) ** (1.0 / len(cell.box))
    widest = int(np.argmax(gaps > gaps.max() - SAME_LAYER * spacing))
    return float((x[widest] + 0.5 * gaps[widest]) % size)

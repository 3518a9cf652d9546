"""The periodic cell of the user's crystal, and its deformation by LAMMPS."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from gimpmd_md.engines.lammps.library import Engine
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.mechanics.units import UNITS

SAMPLE = np.array([[1.007, 0.01], [0.0, 0.996]])
"""A deformation gradient: a strain of about 1 % in a direction without symmetry."""

SETTLED, UNSETTLED = 1e-9, 1e-6
"""Forces on relaxed atoms, and on atoms that must be relaxed, over the force of a strain of 1 % on
the area of one atom. Round-off stays below the first."""


@dataclass(frozen=True)
class Cell:
    """A two-dimensional periodic cell.

    Attributes
    ----------
    script : str
        LAMMPS script that made it, for messages.
    box : ndarray, shape ``(2, 2)``
        Edges of the undeformed cell as columns; the first lies along x.
    low : tuple of float
        Its lower corner (length units).
    density : float
        Mass per area.
    tolerance : float or None
        Force (energy / length) at which the atoms in the strained cell count as relaxed. None for a
        Bravais lattice, whose atoms follow the strain.
    """

    script: str
    engine: Engine
    box: Floats
    low: tuple[float, float]
    density: float
    tolerance: float | None = None

    def deform(self, F: Floats) -> tuple[float, Floats]:
        """Deform the undeformed cell, and relax the atoms in it.

        Parameters
        ----------
        F : ndarray, shape ``(2, 2)``
            Deformation gradient, upper triangular: LAMMPS keeps the first edge along x.

        Returns
        -------
        energy : float
            Potential energy per area of the undeformed cell (pressure units).
        tau : ndarray, shape ``(2, 2)``
            Kirchhoff stress ``J sigma`` (pressure units).
        """
        (lx, xy), (_, ly) = F @ self.box
        (x, y), engine = self.low, self.engine
        settle = (
            "run 0 post no" if self.tolerance is None else f"minimize 0 {self.tolerance} 1000 10000"
        )
        engine.commands(
            [
                f"change_box all x final {x:.17g} {x + lx:.17g} y final {y:.17g} {y + ly:.17g} "
                f"xy final {xy:.17g} remap units box",
                settle,
            ]
        )
        style = str(engine.lammps.extract_global("units"))
        area = float(np.linalg.det(self.box))
        energy = engine.thermo("pe") / area * UNITS[style].nktv2p
        xx, yy, shear = (-engine.thermo(name) for name in ("pxx", "pyy", "pxy"))
        return energy, float(np.linalg.det(F)) * np.array([[xx, shear], [shear, yy]])


@contextmanager
def open_cell(script: str, units: str, comm: Any, log: Path) -> Iterator[Cell]:
    """Make a cell; LAMMPS is closed at the end.

    Parameters
    ----------
    script : str
        LAMMPS script that makes a periodic two-dimensional cell with its potential.
    units : str
        Unit style of the case.
    log : Path
        LAMMPS's log file.

    Raises
    ------
    BackendError
        LAMMPS refuses the script, or the cell is not two-dimensional, periodic, and in these units.
    """
    engine = Engine(comm, log)
    try:
        engine.script(script, {})
        _check(script, units, engine)
        engine.commands(
            [
                "velocity all set 0 0 0",
                "fix gimpmd_plane all enforce2d",
                "thermo_style custom step pe pxx pyy pxy fmax",
                "thermo_modify norm no",
                "change_box all triclinic",
            ]
        )
        low, high, xy, *_ = engine.lammps.extract_box()
        box = np.array([[high[0] - low[0], xy], [0.0, high[1] - low[1]]])
        density = engine.evaluate("mass(all)") / float(np.linalg.det(box))
        yield _with_tolerance(Cell(script, engine, box, (low[0], low[1]), density))
    finally:
        engine.close()


def _with_tolerance(cell: Cell) -> Cell:
    """Relax the atoms, and find out whether they must be relaxed under strain."""
    engine = cell.engine
    spacing = float(np.linalg.det(cell.box) / engine.lammps.get_natoms()) ** 0.5
    units = UNITS[str(engine.lammps.extract_global("units"))]
    stress = cell.deform(SAMPLE)[1] - cell.deform(np.eye(2))[1]
    force = float(np.linalg.norm(stress)) * spacing / units.nktv2p  # of the strain on one atom
    settled = replace(cell, tolerance=SETTLED * force)
    settled.deform(np.eye(2))
    cell.deform(SAMPLE)
    return settled if engine.thermo("fmax") > UNSETTLED * force else cell


def _check(script: str, units: str, engine: Engine) -> None:
    style = engine.lammps.extract_global("units")
    if style != units:
        raise BackendError(f"{script}: units {style}, but the case has units: {units}")
    if engine.lammps.extract_setting("dimension") != 2:
        raise BackendError(f"{script}: the cell must be two-dimensional (dimension 2)")
    if engine.lammps.get_natoms() == 0:
        raise BackendError(f"{script}: makes no atoms")
    periodic = engine.lammps.extract_box()[5]
    if not (periodic[0] and periodic[1]):
        raise BackendError(f"{script}: the cell must be periodic (boundary p p p)")

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
from gimpmd_schemas.mechanics.elasticity import VOIGT
from gimpmd_schemas.mechanics.units import UNITS

SAMPLE = np.array([[1.007, 0.01], [0.0, 0.996]])
"""A deformation gradient: a strain of about 1 % in a direction without symmetry."""

_SAMPLE_3D = np.array([[1.007, 0.01, -0.006], [0.0, 0.996, 0.008], [0.0, 0.0, 1.003]])

SETTLED, UNSETTLED = 1e-9, 1e-6
"""Forces on relaxed atoms, and on atoms that must be relaxed, over the force of a strain of 1 % on
the area of one atom. Round-off stays below the first."""

IMAGES = 2
"""Periodic images of a cell, on either side, in which neighbours are searched."""

_AXES = "xyz"


@dataclass(frozen=True)
class Cell:
    """A periodic cell in d dimensions.

    Attributes
    ----------
    script : str
        What made it, for messages: usually a LAMMPS script.
    box : ndarray, shape ``(d, d)``
        Edges of the undeformed cell as columns, upper triangular: the first lies along x.
    low : tuple of float
        Its lower corner (length units).
    density : float
        Mass per area or volume.
    tolerance : float or None
        Force (energy / length) at which the atoms in the strained cell count as relaxed. None for a
        Bravais lattice, whose atoms follow the strain.
    """

    script: str
    engine: Engine
    box: Floats
    low: tuple[float, ...]
    density: float
    tolerance: float | None = None

    def deform(self, F: Floats) -> tuple[float, Floats]:
        """Deform the undeformed cell, and relax the atoms in it.

        Parameters
        ----------
        F : ndarray, shape ``(d, d)``
            Deformation gradient, upper triangular: LAMMPS keeps the first edge along x.

        Returns
        -------
        energy : float
            Potential energy per area or volume of the undeformed cell (pressure units).
        tau : ndarray, shape ``(d, d)``
            Kirchhoff stress ``J sigma`` (pressure units).
        """
        engine, dim = self.engine, len(self.box)
        settle = (
            "run 0 post no" if self.tolerance is None else f"minimize 0 {self.tolerance} 1000 10000"
        )
        engine.commands([f"change_box all {self._final(F @ self.box)} remap units box", settle])
        style = str(engine.lammps.extract_global("units"))
        size = float(np.linalg.det(self.box))
        energy = engine.thermo("pe") / size * UNITS[style].nktv2p
        sigma = np.empty((dim, dim))
        for i, j in VOIGT[dim]:
            sigma[i, j] = sigma[j, i] = -engine.thermo(f"p{_AXES[i]}{_AXES[j]}")
        return energy, float(np.linalg.det(F)) * sigma

    def around(self) -> Floats:
        """Vectors from the first atom to all others and their periodic images, shape ``(n, d)``.

        The cell must be as it was made, and not deformed.
        """
        x = self.engine.vectors("x")
        away = (x - x[0] + self.images()[:, None]).reshape(-1, len(self.box))
        return np.asarray(away[np.linalg.norm(away, axis=1) > 0.0])

    def images(self) -> Floats:
        """Vectors from the undeformed cell to its periodic images and itself, shape ``(n, d)``."""
        n, dim = np.arange(-IMAGES, IMAGES + 1), len(self.box)
        return np.asarray(np.stack(np.meshgrid(*[n] * dim), axis=-1).reshape(-1, dim) @ self.box.T)

    def _final(self, edges: Floats) -> str:
        """Words of ``change_box`` that give the box its edges; its lower corner stays."""
        words = []
        for i, low in enumerate(self.low):
            words.append(f"{_AXES[i]} final {low:.17g} {low + edges[i, i]:.17g}")
            words += [
                f"{_AXES[i]}{_AXES[j]} final {edges[i, j]:.17g}" for j in range(i + 1, len(edges))
            ]
        return " ".join(words)


def upright(F: Floats) -> tuple[Floats, Floats]:
    """Rotation Q and upper triangular R of a deformation gradient ``F = Q R``, all ``(d, d)``."""
    Q, R = np.linalg.qr(F)
    signs = np.sign(np.diag(R))
    return Q * signs, signs[:, None] * R


@contextmanager
def open_cell(
    script: str, units: str | None, comm: Any, log: Path, dims: tuple[int, ...] = (2,)
) -> Iterator[Cell]:
    """Make a cell; LAMMPS is closed at the end.

    Parameters
    ----------
    script : str
        LAMMPS script that makes a periodic cell with its potential.
    units : str or None
        Unit style of the case; None accepts any that gimpmd knows.
    log : Path
        LAMMPS's log file.
    dims : tuple of int
        Accepted numbers of dimensions.

    Raises
    ------
    BackendError
        LAMMPS refuses the script, or the cell is not periodic, of these dimensions and units.
    """
    engine = Engine(comm, log)
    try:
        engine.script(script, {})
        _check(script, units, dims, engine)
        yield settled(cell_of(script, engine))
    finally:
        engine.close()


def cell_of(script: str, engine: Engine) -> Cell:
    """The cell that LAMMPS holds, with its atoms where they are."""
    dim = engine.lammps.extract_setting("dimension")
    pressures = " ".join(f"p{_AXES[i]}{_AXES[j]}" for i, j in VOIGT[dim])
    engine.commands(
        [
            "velocity all set 0 0 0",
            *(["fix gimpmd_plane all enforce2d"] if dim == 2 else []),
            f"thermo_style custom step pe {pressures} fmax",
            "thermo_modify norm no",
            "change_box all triclinic",
        ]
    )
    low, high, xy, yz, xz, *_ = engine.lammps.extract_box()
    box = np.diag(np.subtract(high, low))
    box[0, 1], box[0, 2], box[1, 2] = xy, xz, yz
    box = box[:dim, :dim]
    density = engine.evaluate("mass(all)") / float(np.linalg.det(box))
    return Cell(script, engine, box, tuple(low[:dim]), density)


def settled(cell: Cell, accuracy: float = SETTLED) -> Cell:
    """Relax the atoms, and find out whether they must be relaxed under strain.

    Parameters
    ----------
    cell : Cell
    accuracy : float
        Forces on relaxed atoms, over the force of a strain of 1 % on the area of one atom.
    """
    engine, dim = cell.engine, len(cell.box)
    sample = SAMPLE if dim == 2 else _SAMPLE_3D
    spacing = float(np.linalg.det(cell.box) / engine.lammps.get_natoms()) ** (1.0 / dim)
    units = UNITS[str(engine.lammps.extract_global("units"))]
    stress = cell.deform(sample)[1] - cell.deform(np.eye(dim))[1]
    # force of the strain on the area of one atom
    force = float(np.linalg.norm(stress)) * spacing ** (dim - 1) / units.nktv2p
    relaxed = replace(cell, tolerance=accuracy * force)
    relaxed.deform(np.eye(dim))
    cell.deform(sample)
    return relaxed if engine.thermo("fmax") > UNSETTLED * force else cell


def _check(script: str, units: str | None, dims: tuple[int, ...], engine: Engine) -> None:
    style = engine.lammps.extract_global("units")
    if units is not None and style != units:
        raise BackendError(f"{script}: units {style}, but the case has units: {units}")
    if style not in UNITS:
        raise BackendError(f"{script}: units {style}; gimpmd knows {', '.join(UNITS)}")
    dim = engine.lammps.extract_setting("dimension")
    if dim not in dims:
        wanted = " or ".join(str(d) for d in dims)
        raise BackendError(f"{script}: dimension {dim}; the cell must have dimension {wanted}")
    if engine.lammps.get_natoms() == 0:
        raise BackendError(f"{script}: makes no atoms")
    if not all(engine.lammps.extract_box()[5][:dim]):
        raise BackendError(f"{script}: the cell must be periodic (boundary p p p)")

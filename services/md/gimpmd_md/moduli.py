"""Density and elastic moduli of the user's crystal, measured by LAMMPS on a periodic cell."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from gimpmd_md.engine import Engine
from gimpmd_schemas.case import Elastic
from gimpmd_schemas.errors import BackendError

STRAIN = 1e-4
"""Central differences of this strain err by its square times the third-order moduli."""

MAX_REST_STRAIN = 1e-3
"""Largest accepted stress of the undeformed cell, over the modulus."""

MAX_ANISOTROPY = 1e-2
"""Largest accepted ``|C11 - C12 - 2 C66| / C11``; also of ``|C11 - C22| / C11``."""


def measure(cell: str, units: str, comm: Any, log: Path) -> Elastic:
    """Measure a crystal by small static strains.

    Parameters
    ----------
    cell : str
        LAMMPS script that makes a periodic two-dimensional cell with its potential.
    units : str
        The unit style of the case.

    Returns
    -------
    Elastic
        Density (mass / length^2), ``lame = C12`` and ``shear = C66`` (pressure units).

    Raises
    ------
    BackendError
        LAMMPS refused the script; the cell is under stress, not periodic, or not isotropic.
    """
    engine = Engine(comm, log)
    try:
        engine.script(cell, {})
        _check(cell, units, engine)
        return _moduli(cell, engine)
    finally:
        engine.close()


def _check(cell: str, units: str, engine: Engine) -> None:
    style = engine.lammps.extract_global("units")
    if style != units:
        raise BackendError(f"{cell}: units {style}, but the case says units: {units}")
    if engine.lammps.extract_setting("dimension") != 2:
        raise BackendError(f"{cell}: the cell must be two-dimensional (dimension 2)")
    if engine.lammps.get_natoms() == 0:
        raise BackendError(f"{cell}: makes no atoms")
    periodic = engine.lammps.extract_box()[5]
    if not (periodic[0] and periodic[1]):
        raise BackendError(f"{cell}: the cell must be periodic (boundary p p p)")


def _moduli(cell: str, engine: Engine) -> Elastic:
    engine.commands(
        [
            "velocity all set 0 0 0",
            "fix gimpmd_plane all enforce2d",
            "thermo_style custom step pe pxx pyy pxy",
            "thermo_modify norm no",
            "change_box all triclinic",
        ]
    )
    low, high, *_ = engine.lammps.extract_box()
    edges = np.subtract(high, low)[:2]
    density = engine.evaluate("mass(all)") / float(edges[0] * edges[1])
    rest = _stress(engine)

    # columns: stress per unit of strain xx, yy and (engineering) xy
    C = np.empty((3, 3))
    changes = (("x delta 0", edges[0]), ("y delta 0", edges[1]), ("xy delta", edges[1]))
    for column, (change, edge) in enumerate(changes):
        stresses = []
        for strain in (STRAIN, -STRAIN):
            engine.commands([f"change_box all {change} {strain * edge:.17g} remap units box"])
            stresses.append(_stress(engine))
            engine.commands([f"change_box all {change} {-strain * edge:.17g} remap units box"])
        C[:, column] = (stresses[0] - stresses[1]) / (2.0 * STRAIN)
    return _isotropic(cell, density, rest, C)


def _stress(engine: Engine) -> np.ndarray[Any, Any]:
    """Stress (xx, yy, xy) of the cell with its internal freedom relaxed (pressure units)."""
    engine.commands(["minimize 0.0 1e-12 1000 10000"])
    return -np.array([engine.thermo(name) for name in ("pxx", "pyy", "pxy")])


def _isotropic(
    cell: str, density: float, rest: np.ndarray[Any, Any], C: np.ndarray[Any, Any]
) -> Elastic:
    c11, c22 = C[0, 0], C[1, 1]
    c12, c66 = 0.5 * (C[0, 1] + C[1, 0]), C[2, 2]
    if not (c11 > 0.0 and c66 > 0.0):
        raise BackendError(f"{cell}: the crystal is unstable: C11 = {c11:g}, C66 = {c66:g}")
    if np.abs(rest).max() > MAX_REST_STRAIN * c11:
        raise BackendError(
            f"{cell}: the cell is under stress (xx, yy, xy) = ({rest[0]:.4g}, {rest[1]:.4g}, "
            f"{rest[2]:.4g}); use the lattice constant of zero pressure"
        )
    anisotropy = max(abs(c11 - c12 - 2.0 * c66), abs(c11 - c22)) / c11
    if anisotropy > MAX_ANISOTROPY:
        raise BackendError(
            f"{cell}: the crystal is not isotropic in the plane: C11 = {c11:.6g}, C22 = {c22:.6g}, "
            f"C12 = {c12:.6g}, C66 = {c66:.6g}; give the material with from: case"
        )
    return Elastic(density=float(density), lame=float(c12), shear=float(c66))

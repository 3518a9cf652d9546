"""Resistance of a crystal to a crack: the energy of the surfaces that it makes."""

from __future__ import annotations

import numpy as np

from gimpmd_deploy.analysis.crack import Crack, crack_of
from gimpmd_deploy.launch.asking import ask_surfaces
from gimpmd_deploy.results.run import Run
from gimpmd_schemas.errors import InputError, Problem

ALIGNED = 1e-6
"""Largest component of a normal that counts as zero."""


def crack_resistance(run: Run, crack: Crack | None = None, *, relaxed: bool = True) -> float:
    """Energy ``2 gamma`` of both faces of a crack per advance (pressure times length).

    LAMMPS measures it on the periodic cell that ``continuum.material.cell`` names: it cuts the
    crystal normal to the crack plane. A crack that dissipates nothing grows if its energy release
    rate is larger (Griffith).

    Parameters
    ----------
    crack : Crack, optional
        The normal of its plane must lie along an axis of the cell; default is the first of the
        case.
    relaxed : bool
        Whether the atoms of the faces may move to rest.

    Raises
    ------
    InputError
        The normal does not lie along an axis.
    BackendError
        The case names no cell, or LAMMPS refuses it.
    """
    normal = np.abs((crack or crack_of(run)).plane.normal)
    axis = int(np.argmax(normal))
    if np.delete(normal, axis).max() > ALIGNED:
        hint = "make a cell whose axes lie along the crack, and give its 2 gamma instead"
        message = "the crack plane is not normal to an axis of the cell"
        raise InputError(str(run.folder), [Problem("continuum.cracks", None, message, hint)])
    surfaces = ask_surfaces(run.case, run.folder / "input" / "case.yaml")
    return 2.0 * (surfaces.relaxed if relaxed else surfaces.unrelaxed)[axis]

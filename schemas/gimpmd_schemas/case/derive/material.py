"""Material of a case, and its stiffness and wave speeds."""

from __future__ import annotations

from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case import materials
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.materials import Material, MeasuredByMd
from gimpmd_schemas.mechanics.elasticity import WaveKind


def material(case: Case) -> Material:
    """Return the material with its numbers.

    Raises
    ------
    ValueError
        LAMMPS has not measured the material yet.
    """
    if isinstance(case.continuum.material, MeasuredByMd):
        raise ValueError("the material has not been measured yet")
    return case.continuum.material


def stiffness(case: Case) -> Floats:
    """Stiffness at small strains (pressure units), shape ``(3, 3)`` or ``(6, 6)``, Voigt order."""
    return materials.stiffness(material(case), case.dim)


def slowest_speed(case: Case, axis: int) -> float:
    """Speed of the slowest plane wave along an axis (length / time)."""
    return materials.slowest_speed(material(case), case.units, case.dim, axis)


def wave_speed(case: Case, kind: WaveKind) -> float:
    """Speed of plane waves (length / time); see `gimpmd_schemas.case.materials.wave_speed`."""
    return materials.wave_speed(material(case), case.units, case.dim, kind)

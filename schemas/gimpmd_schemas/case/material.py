"""Numbers that follow from a material: stiffness, wave speeds, thermal energy."""

from __future__ import annotations

import numpy as np

from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.form import Anisotropic, Elastic, Isotropic, Material
from gimpmd_schemas.mechanics import elasticity
from gimpmd_schemas.mechanics.units import UNITS


def stiffness(material: Material, dim: int) -> Floats:
    """Stiffness at small strains (pressure units), shape ``(3, 3)`` or ``(6, 6)``, Voigt order."""
    if isinstance(material, Anisotropic):
        return np.array(material.stiffness)
    return elasticity.isotropic(_lame(material), material.shear, dim)


def wave_speed(material: Material, units: str, dim: int, kind: elasticity.WaveKind) -> float:
    """Speed of plane waves, or ``sqrt(E / rho)`` of paper Eq. 17 (length / time).

    For an anisotropic material these are the fastest (P) and slowest (S) wave along the axes, and
    the bar wave along x.
    """
    if isinstance(material, Anisotropic):
        modulus = elasticity.anisotropic_modulus(stiffness(material, dim), kind)
    else:
        modulus = elasticity.isotropic_modulus(_lame(material), material.shear, dim, kind)
    return _speed(material, units, modulus)


def axial_wave_speed(material: Material, units: str, dim: int, axis: int, component: int) -> float:
    """Speed of a plane wave along an axis that moves the body along a component."""
    tensor = elasticity.christoffel(stiffness(material, dim), axis)
    return _speed(material, units, float(tensor[component, component]))


def thermal_energy(temperature: float | None, units: str) -> float | None:
    """Boltzmann's constant times a temperature, in mechanical units; None for None."""
    if temperature is None:
        return None
    style = UNITS[units]
    return style.energy_to_mechanical(style.boltz * temperature)


def _speed(material: Material, units: str, modulus: float) -> float:
    return float((UNITS[units].stress_to_mechanical(modulus) / material.density) ** 0.5)


def _lame(material: Isotropic) -> float:
    """Lame's lambda in the plane."""
    if isinstance(material, Elastic) and material.plane == "stress":
        return elasticity.plane_stress(material.lame, material.shear)
    return material.lame

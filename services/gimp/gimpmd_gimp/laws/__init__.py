"""Constitutive laws: from the deformation gradient of a material point to its stress.

A solver sees a law through the protocol `Law` alone. A new one is a class with the members of
`Law` in a module of its own, and a line in `make_law` if a case file is to name it.
"""

from __future__ import annotations

import numpy as np

from gimpmd_gimp.laws.anisotropic import AnisotropicElastic
from gimpmd_gimp.laws.cauchy_born import CauchyBorn
from gimpmd_gimp.laws.lattice_sum import LatticeSum
from gimpmd_gimp.laws.law import Law
from gimpmd_gimp.laws.linear import LinearElastic
from gimpmd_gimp.laws.neo_hookean import NeoHookean
from gimpmd_gimp.laws.thermal import thermal_forces, thermal_stress
from gimpmd_schemas.case.form import Anisotropic, Case, Hyperelastic, PairLattice
from gimpmd_schemas.mechanics.units import UNITS, Units

__all__ = [
    "AnisotropicElastic",
    "CauchyBorn",
    "LatticeSum",
    "Law",
    "LinearElastic",
    "NeoHookean",
    "make_law",
    "thermal_forces",
    "thermal_stress",
]


def make_law(case: Case) -> Law:
    """Law of a case's continuum, in mechanical units.

    Raises
    ------
    ValueError
        The material has not been measured yet.
    BackendError
        A temperature is asked for of a crystal that has no vibrations.
    """
    mechanical = UNITS[case.units].stress_to_mechanical
    material = case.material()
    if isinstance(material, Anisotropic):
        return AnisotropicElastic(material.density, mechanical(1.0) * case.stiffness())
    if isinstance(material, Hyperelastic):
        coefficients = mechanical(1.0) * np.array(material.coefficients)
        return CauchyBorn(material.density, coefficients, material.strain_limit, case.dim)
    if isinstance(material, PairLattice):
        return _lattice_sum(material, UNITS[case.units], case.heat())
    moduli = material.density, mechanical(material.lame), mechanical(material.shear)
    if material.model == "neo-hookean":
        return NeoHookean(*moduli)
    return (
        LinearElastic.plane_stress(*moduli)
        if material.plane == "stress"
        else LinearElastic(*moduli)
    )


def _lattice_sum(material: PairLattice, units: Units, heat: float | None) -> LatticeSum:
    bonds, area = np.array(material.bonds), material.area
    energy = [[units.energy_to_mechanical(c) for c in bond] for bond in material.energy]
    thermal = None if heat is None else thermal_stress(bonds, energy, area, heat)
    return LatticeSum(material.density, area, bonds, energy, material.stretch_limit, thermal)

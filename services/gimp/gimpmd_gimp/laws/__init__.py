"""Constitutive laws: the stress of a material point from its deformation gradient and history.

The solver uses a law only through the protocol `Law`. To add a law, write a class with the members
of `Law` in a module of its own. To make it available in case files, add the struct of its material
to the case form, a function ``from_material`` to its module, and a line to ``BUILDERS``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from gimpmd_gimp.laws import (
    anisotropic,
    cauchy_born,
    j2_plasticity,
    lattice_sum,
    linear,
    neo_hookean,
)
from gimpmd_gimp.laws.anisotropic import AnisotropicElastic
from gimpmd_gimp.laws.cauchy_born import CauchyBorn
from gimpmd_gimp.laws.j2_plasticity import J2Plasticity
from gimpmd_gimp.laws.lattice_sum import LatticeSum
from gimpmd_gimp.laws.law import InelasticLaw, Law
from gimpmd_gimp.laws.linear import LinearElastic
from gimpmd_gimp.laws.neo_hookean import NeoHookean
from gimpmd_gimp.laws.thermal import thermal_forces, thermal_stress
from gimpmd_schemas.case.form import J2, Anisotropic, Elastic, Hyperelastic, PairLattice
from gimpmd_schemas.case.plan import Plan

__all__ = [
    "AnisotropicElastic",
    "CauchyBorn",
    "InelasticLaw",
    "J2Plasticity",
    "LatticeSum",
    "Law",
    "LinearElastic",
    "NeoHookean",
    "make_law",
    "thermal_forces",
    "thermal_stress",
]


def make_law(plan: Plan) -> Law:
    """Law of the plan's material, in mechanical units.

    Raises
    ------
    BackendError
        The plan has a temperature, but the crystal is unstable or its bonds do not span its
        primitive cell, so that its vibrations are unknown.
    """
    material = plan.continuum.material
    return BUILDERS[type(material)](material, plan)


def _isotropic(material: Elastic, plan: Plan) -> Law:
    model = neo_hookean if material.model == "neo-hookean" else linear
    law: Law = model.from_material(material, plan)
    return law


BUILDERS: Mapping[type, Callable[[Any, Plan], Law]] = {
    Elastic: _isotropic,
    Anisotropic: anisotropic.from_material,
    Hyperelastic: cauchy_born.from_material,
    PairLattice: lattice_sum.from_material,
    J2: j2_plasticity.from_material,
}
"""What makes the law of each kind of material."""

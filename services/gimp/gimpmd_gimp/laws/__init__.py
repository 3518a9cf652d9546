"""Constitutive laws: the stress of a material point from its deformation gradient and history.

The solver uses a law only through the protocol `Law`. To add a law, write a class with the members
of `Law` in a module of its own. To make it available in case files, add the struct of its material
to `gimpmd_schemas.case.materials`, and a mapping ``MATERIALS`` to its module, which says how the
law is made from the material.
"""

from __future__ import annotations

from gimpmd_gimp.laws.anisotropic import AnisotropicElastic
from gimpmd_gimp.laws.cauchy_born import CauchyBorn
from gimpmd_gimp.laws.embedded_sum import EmbeddedSum
from gimpmd_gimp.laws.j2_plasticity import J2Plasticity
from gimpmd_gimp.laws.lattice_sum import LatticeSum
from gimpmd_gimp.laws.law import InelasticLaw, Law
from gimpmd_gimp.laws.linear import LinearElastic
from gimpmd_gimp.laws.neo_hookean import NeoHookean
from gimpmd_gimp.laws.thermal import thermal_forces, thermal_stress
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.registry import collect

__all__ = [
    "AnisotropicElastic",
    "CauchyBorn",
    "EmbeddedSum",
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
    law: Law = collect(__name__, "MATERIALS")[type(material)](material, plan)
    return law

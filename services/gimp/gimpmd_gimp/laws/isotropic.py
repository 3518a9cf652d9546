"""Laws of a material ``from: moduli``."""

from __future__ import annotations

from gimpmd_gimp.laws import linear, neo_hookean
from gimpmd_gimp.laws.law import Law, LawMakers
from gimpmd_schemas.case.materials import Elastic
from gimpmd_schemas.case.plan import Plan


def from_material(material: Elastic, plan: Plan) -> Law:
    """Law of the model that the material names."""
    if material.model == "neo-hookean":
        return neo_hookean.from_material(material, plan)
    return linear.from_material(material, plan)


MATERIALS: LawMakers = {Elastic: from_material}

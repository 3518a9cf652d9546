"""The model that a material ``from: moduli`` names decides on its law."""

from __future__ import annotations

import pytest

from gimpmd_gimp.laws import LinearElastic, NeoHookean
from gimpmd_gimp.laws.isotropic import MATERIALS
from gimpmd_schemas.case.materials import Elastic
from gimpmd_schemas.case.plan import make_plan


@pytest.mark.parametrize(
    ("model", "kind"), [("linear", LinearElastic), ("neo-hookean", NeoHookean)]
)
def test_the_law_of_a_model(build, model, kind) -> None:
    moduli = {"from": "moduli", "density": 2.0, "lame": 3.0, "shear": 0.5, "model": model}
    plan = make_plan(build(continuum={"material": moduli}))
    law = MATERIALS[Elastic](plan.continuum.material, plan)
    assert type(law) is kind
    assert (law.density, law.lame, law.shear) == (2.0, 3.0, 0.5)

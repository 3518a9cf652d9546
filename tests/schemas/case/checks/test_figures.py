"""Fields that a case wants to have drawn."""

import msgspec
import pytest

from gimpmd_schemas.case.checks.figures import check_figures, figure_fields
from gimpmd_schemas.case.checks.rules import Rules
from gimpmd_schemas.case.form import Case
from tests.cases import BLOCK_3D, CASE, changed


def problems(changes):
    rules = Rules()
    check_figures(msgspec.convert(changed(CASE, changes), Case), rules)
    return rules.problems


@pytest.mark.parametrize("space", [{}, BLOCK_3D])
def test_every_field_may_be_chosen(space):
    names = figure_fields(3 if space else 2)
    assert not problems({**space, "output.figures": list(names)})
    assert {"sigma_yy", "velocity_x", "temperature"} <= set(names)


def test_unknown_fields_are_named():
    (problem,) = problems({"output.figures": ["sigma_yy", "sigma_zz"]})
    assert (problem.key, problem.value) == ("output.figures[1]", "sigma_zz")
    assert problem.hint.startswith("choose from sigma_xx, sigma_yy, sigma_xy, strain_xx")

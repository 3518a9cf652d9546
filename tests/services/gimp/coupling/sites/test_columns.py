"""Columns of crystals with several atoms per primitive cell, as LAMMPS measures them for a run.

They repeat along y after two cells. Without a gradient term that goes round this axis, uniform
strain leaves up to 2e-3 of the traction, and the set-ups are refused.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from gimpmd_gimp.coupling.sites.terms import site_terms
from gimpmd_gimp.gimp import Gimp
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan
from tests.copper_sites import MAGNESIUM, SILICON_110, Metal, copper_case, write_scripts
from tests.measuring import measured

COARSER, COARSEST = (replace(SILICON_110, periods=times * 0.5**0.5) for times in (2.0, 2.5))


@pytest.mark.long
@pytest.mark.parametrize(
    ("metal", "start", "end"),
    [
        (SILICON_110, 2.3, 9.7),
        (SILICON_110, 2.6, 9.9),
        (COARSER, 2.3, 8.7),
        (COARSER, 2.4, 9.1),
        (COARSEST, 2.3, 8.2),
        (MAGNESIUM, 2.3, 9.3),
        (MAGNESIUM, 2.7, 9.6),
        (MAGNESIUM, 2.5, 9.8),
    ],
)
def test_uniform_strain_is_in_balance(
    metal: Metal, start: float, end: float, tmp_path: Path
) -> None:
    """Faces {001} and {110} of silicon, {11-20} and {0001} of magnesium; ends in cells."""
    write_scripts(tmp_path, metal)
    region = (start, end), None, (start - 0.1, end + 0.3)
    case = msgspec.convert(copper_case((12, 2, 12), region, 0.1, metal), Case)
    plan = make_plan(measured(case, tmp_path))
    solver = Gimp(plan, None, tmp_path)
    assert solver.layout is not None
    _, misfit, notes = site_terms(plan, solver.layout, solver)  # raises if not in balance
    assert misfit < 1e-4
    assert notes == ()

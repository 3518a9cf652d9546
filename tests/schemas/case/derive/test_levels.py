"""Cells and boxes of the levels."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from gimpmd_schemas.case.derive import choices, levels, material, regions, times, zones
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan

Make = Callable[..., Case]


def test_background_grid_covers_the_domain(make: Make) -> None:
    grid = make_plan(make(domain__periodic=[False, True])).background_grid()
    assert (grid.origin, grid.cell, grid.cells) == ((0.0, 0.0), 4.0, (30, 20))
    assert grid.periodic == (False, True)


def test_levels_halve_cells_and_steps_refer_to_the_finest(make: Make) -> None:
    refined = [{"boxes": [[[0, 112], [0, 80]]]}, {"boxes": [[[0, 104], [0, 80]]]}]
    case = make(grid__levels=refined)
    assert levels.cells(case) == (4.0, 2.0, 1.0)
    assert levels.finest_cell(case) == 1.0
    assert levels.boxes(case)[0] == (case.domain.box,)
    assert levels.boxes(case)[2] == (((0.0, 104.0), (0.0, 80.0)),)
    assert make_plan(case).background_grid().cells == (120, 80)
    found = zones.zones(case)
    assert (found.outer, found.incommunicado, found.inner, found.filter) == (1.0, 0.0, 3.5, 2.0)
    assert choices.filter_rate(case) == pytest.approx(0.5 * material.wave_speed(case, "P"))
    assert times.step(case) == 40 * 0.002
    auto, coarse = (make(time__md_steps="auto", grid__levels=x) for x in (refined, []))
    assert times.md_steps(auto) == round(times.md_steps(coarse) / 4)


def test_three_dimensions(make: Make) -> None:
    case = make(only="continuum", domain__box=[[0, 40], [0, 80], [0, 20]], continuum__ranks=8)
    assert case.dim == 3
    assert case.domain.periodic == (False,) * 3
    assert regions.continuum_patches(case) == (2, 4, 1)  # cubes of 20
    assert zones.zones(case).regions[0].interfaces == ((False, False),) * 3
    assert make_plan(case).background_grid().cells == (10, 20, 5)

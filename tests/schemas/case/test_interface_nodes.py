"""Nodes that both sides exchange: those of ghosts, and three columns that the absorber sees."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.interface_nodes import fit_nodes, interface_nodes
from gimpmd_schemas.case.plan import make_plan
from tests.schemas.case.test_plan import FORCE

Make = Callable[..., Case]
WITH: dict[str, Any] = FORCE | {"coupling__absorber": {}}
"""Planes at x = 70, y = 30 and y = 50 in cells of 4, in a domain of 120 x 80."""


def test_without_absorber_the_nodes_are_those_of_ghosts(make: Make) -> None:
    plan = make_plan(make(**FORCE))
    assert fit_nodes(plan).size == 0
    (interface,) = plan.coupled.interfaces
    np.testing.assert_array_equal(
        interface_nodes(plan), interface.ghost_nodes(plan.background_grid())
    )


def test_the_absorber_sees_three_columns_outside_each_plane(make: Make) -> None:
    plan = make_plan(make(**WITH))
    x = plan.background_grid().positions()
    seen = x[fit_nodes(plan)]
    row = seen[np.isclose(seen[:, 1], 40.0), 0]
    np.testing.assert_allclose(row, [76, 80, 84])
    column = seen[np.isclose(seen[:, 0], 40.0), 1]
    np.testing.assert_allclose(column, [16, 20, 24, 56, 60, 64])
    assert seen[:, 0].min() == 0.0  # on the face of the domain, not beyond
    corner = (seen > [70, 50]).all(axis=1)
    assert corner.sum() == 4 * 4 - 1  # by the larger of the distances along the axes
    assert np.isin(fit_nodes(plan), interface_nodes(plan)).all()


@pytest.mark.parametrize("off", [-1e-12, 0.0, 1e-12])
def test_rounding_does_not_decide_about_nodes_at_its_limits(make: Make, off: float) -> None:
    planes = {"right": 72.0 + off, "bottom": 30.0, "top": 50.0}
    plan = make_plan(make(**WITH | {"coupling__planes": planes}))
    seen = plan.background_grid().positions()[fit_nodes(plan)]
    np.testing.assert_allclose(seen[np.isclose(seen[:, 1], 40.0), 0], [80, 84])


def test_nodes_of_coarser_levels_and_on_their_rim_are_not_seen(make: Make) -> None:
    levels = [{"boxes": [[[0, 80], [8, 72]]]}]
    plan = make_plan(make(**WITH, grid__cell=8, grid__levels=levels))
    assert plan.finest_cell == 4.0
    seen = plan.background_grid().positions()[fit_nodes(plan)]
    assert seen[:, 0].max() == 76.0
    assert seen[:, 1].min() == 16.0

"""Shells and slaves of a plan, and the mesh and points that follow from them."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.coupling.nodes import find_nodes
from gimpmd_gimp.coupling.sites.layout import lay_out, slaves_of
from gimpmd_gimp.setup import make_solver
from gimpmd_schemas.case.plan import Plan
from tests.sites_case import CELL, sites_plan


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Plan:
    return sites_plan(tmp_path_factory.mktemp("sites"))


def test_pieces_fill_all_around_the_planes(plan: Plan) -> None:
    layout = lay_out(plan)
    (interface,) = plan.coupled.interfaces
    assert layout.shells.free == (interface.planes,)
    assert layout.shells.active == (interface.second,)
    whole = np.prod([high - low for low, high in plan.domain.box])
    assert layout.pieces.volume.sum() == pytest.approx(whole)  # within five cells of the planes


def test_slaves_take_linear_fields_and_have_no_mass(plan: Plan) -> None:
    layout = lay_out(plan)
    slaves = slaves_of(layout)
    assert slaves is not None
    assert slaves.node.shape[1] == 2
    solver = make_solver(plan, layout=layout)
    grid = layout.grid
    ids = np.flatnonzero(layout.T.diagonal() == 0.0)
    rows = find_nodes(solver, grid, ids)
    assert (rows >= 0).all()
    assert (solver.nodes.M[rows] == 0.0).all()
    assert not solver.mesh.basis[rows].any()
    assert (solver.mesh.counts[rows] == 1.0).all()
    field = solver.mesh.positions() @ np.array([[0.3, 0.1], [-0.2, 0.7]])
    wanted = field[rows].copy()
    field[rows] = np.nan
    solver.nodes.prolong(0, field)
    np.testing.assert_allclose(field[rows], wanted, atol=1e-12)


def test_points_have_all_mass_and_stress_beyond_second_planes_only(plan: Plan) -> None:
    points, (interface,) = make_solver(plan).points, plan.coupled.interfaces

    def area(box: object) -> float:
        return float(np.prod([high - low for low, high in box]))  # type: ignore[attr-defined]

    whole, density = area(plan.domain.box), plan.continuum.material.density
    assert points.mass.sum() == pytest.approx(density * (whole - area(interface.planes)))
    assert points.volume.sum() == pytest.approx(whole - area(interface.second))
    outside = interface.off(points.reference)
    assert (points.volume[~outside] == 0.0).all()
    assert (points.volume[outside] > 0.0).all()
    size = points.mass / density
    np.testing.assert_allclose((2.0 * CELL * points.half).prod(axis=1), size, rtol=1e-9)
    assert np.unique(points.id).size == points.count

"""Method S on the continuum's side, with atoms that follow a known field."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.coupling.velocity import VelocityScheme
from gimpmd_gimp.points.groups import INNER, RIM
from gimpmd_gimp.setup import make_solver
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.zones import MdRegion, Zones


@pytest.fixture(params=["reference", "current"])
def coupled(build, request):
    material = {"from": "moduli", "density": 1.0, "lame": 1.0 / 3.0, "shear": 1.0 / 3.0}
    case = build(
        continuum={"material": material, "configuration": request.param, "xpic": {"every": 0}},
        domain={"box": [[0.0, 40.0], [0.0, 40.0]]},
        md={"region": [[0.0, 24.0], [8.0, 32.0]], "input": "none.in"},
        time={"end": 1.0, "md_timestep": 0.1, "md_steps": 1},
        only=None,
    )
    plan = make_plan(case)
    solver = make_solver(plan)
    coupling = plan.coupled
    grid = plan.background_grid()
    return solver, VelocityScheme(solver, grid, coupling.zones, coupling.filter_rate, 1)


def needed(scheme):
    """Positions of the nodes whose fields the continuum wants."""
    return scheme.solver.mesh.positions()[scheme._needed]


def payload(scheme, velocity):
    x = needed(scheme)
    return {"mass": np.ones(len(x)), "velocity": velocity(x)}


def test_points_deeper_than_the_inner_zone_are_dropped(coupled):
    solver, _ = coupled
    depth = np.min(
        [24.0 - solver.points.reference[:, 0], 12.0 - abs(solver.points.reference[:, 1] - 20.0)], 0
    )
    assert depth.max() < 1.0 + 3.5
    assert solver.points.count < 80 * 80


def test_inner_points_follow_a_linear_field_exactly(coupled):
    solver, scheme = coupled
    L = np.array([[1e-3, 2e-3], [-1e-3, 3e-3]])
    before = solver.points.x.copy()
    scheme.follow_atoms(payload(scheme, lambda x: x @ L.T))
    inner = solver.body.stripes(INNER).order
    expected = np.array([L[0, 0], L[1, 1], L[0, 1] + L[1, 0]]) * solver.dt
    assert solver.points.strain[inner] == pytest.approx(np.tile(expected, (inner.size, 1)))
    moved = solver.points.x - before
    assert moved[inner] == pytest.approx(solver.dt * before[inner] @ L.T)
    others = np.setdiff1d(np.arange(solver.points.count), inner)
    assert (moved[others] == 0.0).all()


def test_the_grid_sees_the_atoms_field_again(coupled):
    """Where inner points alone make the nodal sums, the field is recovered closely."""
    solver, scheme = coupled
    k = 2.0 * np.pi / 8.0
    fields = payload(scheme, lambda x: np.stack([np.sin(k * x[:, 0]), 0.0 * x[:, 0]], axis=1))
    scheme.follow_atoms(fields)
    solver.stages.project()
    seen = solver.V[scheme._needed]
    x = needed(scheme)
    middle = (abs(24.0 - x[:, 0] - 3.0) < 0.6) & (abs(x[:, 1] - 20.0) < 6.0)
    assert middle.sum() >= 10
    error = np.abs(seen - fields["velocity"])[middle].max()
    # one projection alone would leave 1 - g(k) = 8 % at eight cells
    assert error < 0.02


def test_a_uniform_stress_moves_nothing_where_points_end_among_the_atoms(coupled):
    """Their last layer fills nodes by half; its stress must not push them like that of a cut."""
    solver, scheme = coupled
    # in either configuration points still tile the grid
    solver.points.F += np.array([[1e-3, 5e-4], [2e-4, -2e-3]])
    x = solver.points.reference
    inside = ((x > 6.0) & (x < 34.0)).all(axis=1)  # the free faces of the body do move
    deep = inside & solver.body.mask(RIM)
    assert deep.sum() > 40
    scheme.advance()
    assert np.abs(solver.points.dv[inside]).max() < 1e-17
    assert np.abs(solver.points.dv[~inside]).max() > 1e-6


def test_nodes_without_atoms_leave_the_points_alone(coupled):
    solver, scheme = coupled
    fields = payload(scheme, np.zeros_like)
    fields["mass"] = np.zeros_like(fields["mass"])
    scheme.follow_atoms(fields)
    assert np.isfinite(solver.points.v).all()


def test_the_filter_takes_energy_from_noise_near_the_interface_only(coupled):
    solver, scheme = coupled
    rng = np.random.default_rng(3)
    solver.points.v[:] = rng.normal(size=solver.points.v.shape)
    before = solver.points.v.copy()
    scheme.filter_transition()
    change = np.abs(solver.points.v - before).max(axis=1)
    depth = np.min(
        [24.0 - solver.points.reference[:, 0], 12.0 - abs(solver.points.reference[:, 1] - 20.0)], 0
    )
    assert (change[depth <= -2.0] == 0.0).all()
    assert (change[(depth > -2.0) & (depth < 1.0)] > 0.0).mean() > 0.99
    assert (solver.points.v**2).sum() < (before**2).sum()


def test_the_filter_leaves_a_uniform_velocity(coupled):
    solver, scheme = coupled
    solver.points.v[:] = (0.3, -0.2)
    scheme.filter_transition()
    assert solver.points.v == pytest.approx(np.tile([0.3, -0.2], (solver.points.count, 1)))


def test_as_published_inner_points_take_the_atoms_field_alone(coupled):
    """Without corrections and filter, a linear field is met at every point (paper Eq. 5)."""
    solver, _ = coupled
    grid = BackgroundGrid((0.0, 0.0), 1.0, (40, 40), (False, False))
    region = MdRegion(((0.0, 24.0), (8.0, 32.0)), ((False, True), (True, True)))
    zones = Zones((region,), 1.0, 0.5, 3.0, 2.0)
    scheme = VelocityScheme(solver, grid, zones, 0.0, 1, corrections=0)
    L = np.array([[1e-3, 2e-3], [-1e-3, 3e-3]])
    before = solver.points.x.copy()
    inner = solver.body.stripes(INNER).order
    scheme.follow_atoms(payload(scheme, lambda x: x @ L.T))
    assert solver.points.v[inner] == pytest.approx(before[inner] @ L.T, abs=1e-14)
    scheme.filter_transition()
    assert solver.points.v[inner] == pytest.approx(before[inner] @ L.T, abs=1e-14)

"""Energy and forces of corrected pieces, and what uniform strain leaves with them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from gimpmd_gimp.coupling.sites.layout import lay_out, measured
from gimpmd_gimp.coupling.sites.residual import residual
from gimpmd_gimp.coupling.sites.terms import SiteTerms, site_terms, stiffness_of
from gimpmd_gimp.gimp import Gimp
from gimpmd_gimp.laws import NeoHookean
from gimpmd_schemas.case.materials import Anisotropic
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.mechanics.elasticity import unit_strains
from gimpmd_schemas.mechanics.units import UNITS
from tests.sites_case import sites_plan


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Plan:
    return sites_plan(tmp_path_factory.mktemp("sites"))


@pytest.fixture(scope="module")
def terms(plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> SiteTerms:
    """The terms of a law of finite strains, whose moduli are those of the crystal."""
    solver = Gimp(plan, None, tmp_path_factory.mktemp("run"))
    solver.solver.law = NeoHookean(*(getattr(solver.law, k) for k in ("density", "lame", "shear")))
    assert solver.layout is not None
    found, misfit, notes = site_terms(plan, solver.layout, solver)
    assert misfit < 1e-4
    assert notes == ()
    assert isinstance(found, SiteTerms)
    return found


@pytest.fixture(scope="module")
def grid(plan: Plan) -> BackgroundGrid:
    return lay_out(plan).grid


def displacements(terms: SiteTerms, size: float) -> np.ndarray:
    return size * np.random.default_rng(5).normal(size=(terms.nodes.size, 2))


def test_forces_are_minus_the_derivative_of_the_energy(terms: SiteTerms) -> None:
    U, step = displacements(terms, 0.02), 1e-5
    _, force = terms.evaluate(U)
    along = displacements(terms, 1.0)[::-1]
    up, down = (terms.evaluate(U + sign * step * along)[0] for sign in (1.0, -1.0))
    assert -(force * along).sum() == pytest.approx((up - down) / (2.0 * step), rel=1e-6)


def test_small_displacements_are_linear(terms: SiteTerms, grid: BackgroundGrid) -> None:
    linear, size = terms.linear(grid), 1e-5
    U = displacements(terms, size)
    energy, force = terms.evaluate(U)
    assert linear.evaluate(U)[0] == pytest.approx(energy, rel=1e-3)
    at_rest = terms.evaluate(np.zeros_like(U))[1]
    change = np.abs(force - at_rest).max()
    np.testing.assert_allclose(linear.load, at_rest, atol=1e-14)
    np.testing.assert_allclose(linear.evaluate(U)[1], force, atol=1e-3 * change)


def test_a_load_does_work(terms: SiteTerms, grid: BackgroundGrid) -> None:
    load, U = displacements(terms, 0.3)[::-1].copy(), displacements(terms, 0.02)
    loaded = replace(terms, load=load)
    for one, other in ((terms, loaded), (terms.linear(grid), loaded.linear(grid))):
        (energy, force), (less, more) = one.evaluate(U), other.evaluate(U)
        assert energy - less == pytest.approx((load * U).sum())
        np.testing.assert_allclose(more - force, load, atol=1e-12)


def test_uniform_strain_is_in_balance_at_every_node(plan: Plan, terms: SiteTerms) -> None:
    """The corrections take up what ghosts and the continuum beyond plane 2 leave."""
    layout, sites = lay_out(plan), measured(plan)
    force = np.frombuffer(sites.force).reshape(4, -1, 2)
    stress = np.frombuffer(sites.stress).reshape(4, 2, 2)
    grid, linear = layout.grid, terms.linear(layout.grid)
    x = grid.positions()[terms.nodes]
    inner = np.zeros(grid.shape, dtype=bool)
    inner[3:-3, 3:-3] = True
    for m, H in enumerate(unit_strains(2), 1):
        nodal = np.zeros((grid.size, 2))
        nodal[list(sites.nodes)] = force[m]
        left = residual(grid, layout.pieces, nodal, stress[m])
        assert np.abs(left[inner.ravel()]).max() > 1e-3 * stiffness_of(stress).max()
        left[terms.nodes] += linear.evaluate(x @ H.T)[1] - linear.load
        left = (layout.T.T @ left)[inner.ravel()]
        assert np.abs(left).max() < 1e-8 * stiffness_of(stress).max() * grid.cell


def test_thermal_stress_fills_the_space_between_ghosts_and_plane_2(
    plan: Plan, terms: SiteTerms, tmp_path: Path
) -> None:
    """The virial of its nodal forces is minus the stress times the area of that space."""
    stress = np.array([-9.0, -8.0, 0.5])
    mechanical = UNITS[plan.units].stress_to_mechanical(1.0)
    material = Anisotropic(
        density=1.0,
        stiffness=tuple(map(tuple, plan.stiffness().tolist())),
        thermal_stress=tuple((stress / mechanical / 0.1).tolist()),
    )
    warm = msgspec.structs.replace(
        plan,
        continuum=msgspec.structs.replace(plan.continuum, material=material, temperature=0.1),
    )
    solver = Gimp(plan, None, tmp_path)
    assert solver.layout is not None
    added = site_terms(warm, solver.layout, solver)[0].evaluate(np.zeros((terms.nodes.size, 2)))[1]
    added = added - terms.evaluate(np.zeros((terms.nodes.size, 2)))[1]
    virial = added.T @ solver.layout.grid.positions()[terms.nodes]
    layers = np.array(measured(plan).layers)
    (free,), (active,) = solver.layout.shells.free, solver.layout.shells.active
    area = np.prod(np.ptp(active, axis=1)) - np.prod(np.ptp(free, axis=1) + layers)
    exact = -area * stress[[[0, 2], [2, 1]]]
    np.testing.assert_allclose(virial, exact, rtol=1e-9)

"""Stress of atoms by both routes, and largest stresses, in made-up fields."""

from types import SimpleNamespace

import numpy as np
import pytest

from gimpmd_deploy.analysis.stress import atomic_stress, average, grid_strain, maximum_stress
from gimpmd_schemas.errors import InputError
from gimpmd_schemas.mechanics.elasticity import isotropic
from tests.deploy.analysis.fields import SPACING, hexagonal, particles

SITES = hexagonal(((0, 40), (-20, 20)))
H = np.array([[1e-3, 5e-4], [1e-3, -2e-3]])
STRAIN = np.array([1e-3, -2e-3, 1.5e-3])
STIFFNESS = isotropic(27.8, 27.8, 2)


def run_of(atoms=None, points=None, coupling=None):
    plan = SimpleNamespace(
        dim=2,
        finest_cell=4.0,
        stiffness=lambda: STIFFNESS,
        roles=("md",) * (atoms is not None) + ("continuum",) * (points is not None),
        coupling=coupling,
    )
    return SimpleNamespace(
        plan=plan, folder="runs/a", atoms=lambda t=None: atoms, points=lambda t=None: points
    )


def test_uniform_strain_gives_the_same_stress_by_both_routes():
    atoms = particles(SITES, SITES @ H.T, stress=np.tile(STRAIN @ STIFFNESS, (len(SITES), 1)))
    run = run_of(atoms)
    assert grid_strain(atoms, 4.0) == pytest.approx(np.tile(STRAIN, (len(SITES), 1)), abs=1e-12)
    virial, strain = (atomic_stress(run, None, route) for route in ("virial", "strain"))
    assert strain == pytest.approx(virial, abs=1e-9)
    with pytest.raises(ValueError, match="'virial' or 'strain'"):
        atomic_stress(run, None, "hardy")


def test_the_grid_averages_a_wave_as_theory_says():
    """A wave of length w keeps ``1 - (h / w)^2 pi^2 2 / 3`` of its amplitude."""
    sites, h = hexagonal(((0, 160), (-20, 20))), 2.5
    w = 20.0
    k = 2.0 * np.pi / w
    u = np.stack([1e-3 * np.sin(k * sites[:, 0]) / k, 0.0 * sites[:, 0]], axis=1)
    strain = grid_strain(particles(sites, u), h)[:, 0]
    inside = np.abs(sites[:, 0] - 80.0) < 60.0
    wave = np.cos(k * sites[inside, 0])
    kept = (strain[inside] @ wave) / (1e-3 * wave @ wave)
    assert kept == pytest.approx(1.0 - (h / w) ** 2 * np.pi**2 * 2.0 / 3.0, abs=0.02)


@pytest.mark.long
def test_three_dimensions():
    x = np.arange(8.0)
    sites = np.stack(np.meshgrid(x, x, x, indexing="ij"), axis=-1).reshape(-1, 3)
    gradient = 1e-3 * np.arange(9.0).reshape(3, 3)
    strain = grid_strain(particles(sites, sites @ gradient.T, size=1.0), 2.5)
    expected = 1e-3 * np.array([0.0, 4.0, 8.0, 12.0, 8.0, 4.0])
    assert strain == pytest.approx(np.tile(expected, (512, 1)), abs=1e-12)


def test_average_over_a_radius():
    """The mean of ``x^2`` over a disc of radius R is ``R^2 / 4`` more than in its middle."""
    sites = hexagonal(((-20, 20), (-20, 20)), 0.25)
    one = particles(sites, size=0.25)
    middle = np.hypot(*sites.T) < 5.0
    found = average(one, sites[:, 0] ** 2, 4.0, middle)
    assert found == pytest.approx(sites[middle, 0] ** 2 + 4.0, abs=0.15)
    values = np.where(sites[:, 0] > 0, np.nan, 2.0)
    assert average(one, values, 1.0, middle & (sites[:, 0] < 0.5)) == pytest.approx(2.0)
    assert np.isnan(average(one, values, 1.0, middle & (sites[:, 0] > 1.5))).all()


def stress_around(sites, peak=(10.0, 5.0), size=1.0):
    """``sigma_yy = exp(-r^2 / 2 / 3^2)`` around a place."""
    bump = size * np.exp(-((sites - peak) ** 2).sum(axis=1) / 18.0)
    return np.stack([0.0 * bump, bump, 0.0 * bump], axis=1)


def disc_mean(radius):
    """Mean of the bump over a disc around its peak."""
    return 18.0 / radius**2 * (1.0 - np.exp(-(radius**2) / 18.0))


def test_atoms_and_points_give_the_same_largest_stress():
    cell = 2.0
    x = np.arange(-20, 60, cell) + 0.3
    grid = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
    points = particles(grid, stress=stress_around(grid), size=cell)
    atoms = particles(SITES, stress=stress_around(SITES))
    for radius in (4.0, 6.0):
        of_atoms = maximum_stress(run_of(atoms), "yy", radius=radius)
        of_points = maximum_stress(run_of(None, points), "yy", radius=radius)
        assert of_atoms.value == pytest.approx(disc_mean(radius), rel=0.04)
        assert of_points.value == pytest.approx(disc_mean(radius), rel=0.08)
        assert of_atoms.position == pytest.approx((10.0, 5.0), abs=SPACING)
        assert (of_atoms.side, of_points.side) == ("md", "continuum")


def test_the_larger_side_and_the_region_count():
    atoms = particles(SITES, stress=stress_around(SITES))
    points = particles(SITES + np.array([100.0, 0.0]), stress=stress_around(SITES, size=2.0))
    assert maximum_stress(run_of(atoms, points), "yy", radius=3.0).side == "continuum"
    near = maximum_stress(run_of(atoms, points), "yy", radius=3.0, region=((0, 40), (-20, 20)))
    assert near.side == "md"
    with pytest.raises(InputError, match="region"):
        maximum_stress(run_of(atoms, points), "yy", radius=3.0, region=((50, 60), (0, 1)))
    with pytest.raises(InputError, match="choose one of xx, yy, xy"):
        maximum_stress(run_of(atoms), "zz", radius=3.0)


def test_boundary_atoms_and_inner_points_do_not_count():
    zones = SimpleNamespace(depth=lambda x: x[:, 0] - 20.0, energy_plane=0.0)
    coupling = SimpleNamespace(zones=zones)
    one = particles(SITES, stress=stress_around(SITES))  # its peak is at x = 10
    found = maximum_stress(run_of(one, None, coupling), "yy", radius=3.0)
    assert found.position[0] >= 20.0
    assert maximum_stress(run_of(None, one, coupling), "yy", radius=3.0).position[0] < 11.0

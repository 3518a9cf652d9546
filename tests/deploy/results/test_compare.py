"""Differences of two runs: particle by particle, or interpolated through the grid."""

import numpy as np
import pytest

from gimpmd_deploy.results.compare import _errors, compare, interpolated
from gimpmd_deploy.results.particles import Particles
from gimpmd_deploy.results.run import Run
from gimpmd_schemas.errors import InputError
from gimpmd_schemas.grid.background import BackgroundGrid
from tests.deploy.figures.three_d import lattice

GRID = BackgroundGrid((0.0, 0.0), 2.0, (10, 8), (False, False))


def block(edge: float, low=(0.0, 0.0), high=(20.0, 16.0), linear=True) -> Particles:
    """Square particles that tile a box, in a field linear (or constant) in space."""
    axes = [np.arange(a + 0.5 * edge, b, edge) for a, b in zip(low, high, strict=True)]
    x, y = np.meshgrid(*axes, indexing="ij")
    site = np.stack([x.ravel(), y.ravel()], axis=1)
    u = np.stack([0.01 * site[:, 0], -0.02 * site[:, 1]], axis=1) if linear else 0.0 * site + 0.3
    stress = np.stack([site[:, 0], 0.5 * site[:, 1], 0.0 * site[:, 0]], axis=1)
    return Particles(0.0, site, site + u, u, 0.0 * u, stress, np.full(site.shape, edge), {})


def test_constant_field_is_exact_everywhere():
    values, known = interpolated(GRID, block(1.0, linear=False), block(0.5))
    assert known.all()
    np.testing.assert_allclose(values[:, :2], 0.3, rtol=1e-13)


def test_linear_field_is_exact_away_from_the_rim():
    target = block(1.0, low=(4.0, 4.0), high=(16.0, 12.0))
    values, known = interpolated(GRID, block(0.5), target)
    assert known.all()
    np.testing.assert_allclose(values[:, :2], target.displacement, rtol=1e-12)
    np.testing.assert_allclose(values[:, 2], target.stress[:, 1], rtol=1e-12)


def test_places_without_source_are_unknown():
    values, known = interpolated(GRID, block(1.0, high=(10.0, 16.0)), block(1.0))
    assert known[block(1.0).reference[:, 0] < 9.0].all()
    assert not known[block(1.0).reference[:, 0] > 13.0].any()
    assert np.isfinite(values).all()


def test_three_dimensions():
    grid = BackgroundGrid((0.0,) * 3, 2.0, (4, 3, 3), (False, True, False))
    fine, coarse = (lattice(edge, ((0.0, 8.0), (0.0, 6.0), (0.0, 6.0))) for edge in (0.5, 1.0))
    for particles in (fine, coarse):
        particles.displacement[:] = [0.1, 0.2, 0.3]
    values, known = interpolated(grid, fine, coarse)
    assert known.all()
    np.testing.assert_allclose(values[:, :3], coarse.displacement, rtol=1e-13)
    inner = (coarse.reference[:, 0] > 2.0) & (coarse.reference[:, 0] < 6.0)
    np.testing.assert_allclose(values[inner, 3], coarse.stress[inner, 1], rtol=1e-12)


def test_same_particles_are_compared_one_by_one():
    mine, theirs = block(1.0), block(1.0)
    theirs = theirs.where(np.argsort(np.sin(np.arange(len(theirs)))))  # in another order
    theirs.displacement[:] *= 1.25
    displacement, stress = _errors(GRID, mine, theirs, None)
    assert displacement == pytest.approx(0.2)
    assert stress == 0.0


def test_other_particles_are_compared_through_the_grid():
    inside = (4.0, 4.0), (16.0, 12.0)
    displacement, stress = _errors(GRID, block(1.0, *inside), None, block(0.4))
    assert displacement < 1e-12
    assert stress < 1e-12


def test_no_relative_error_against_rest():
    rest = block(1.0)
    rest.displacement[:] = 0.0
    assert _errors(GRID, block(1.0), rest, None)[0] is None
    assert _errors(GRID, block(1.0), None, None) == (None, None)


def test_a_run_does_not_differ_from_itself(block):
    comparison = compare(block, block)
    last = comparison.differences[-1]
    assert last.time == pytest.approx(0.8)
    assert last.displacement_md == last.displacement_continuum == 0.0
    assert comparison.balance_a == comparison.balance_b


def test_a_coupled_run_against_pure_md(block, runs):
    last = compare(block, Run(runs / "block-md")).differences[-1]
    # the front has gone 1.9 cells into a grid that spreads it over about one
    assert 0.0 < last.displacement_continuum < 0.2


def test_the_zones_of_a_run_of_one_side_are_those_of_the_case(block, runs):
    last = compare(Run(runs / "block-continuum"), block).differences[-1]
    # outside the region the grid does as it does when coupled, but for the waves from there
    assert last.displacement_md is None
    assert last.displacement_continuum < 0.05


def test_runs_without_a_common_time(block, runs):
    other = Run(runs / "block-md")
    other.points_file, other.atoms_file.times[:] = None, [1.0, 2.0, 3.0]
    with pytest.raises(InputError, match=r"no output time in common.*at t = 1, 2, 3"):
        compare(block, other)

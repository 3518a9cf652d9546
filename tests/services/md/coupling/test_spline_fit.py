"""The fit of the absorber: against its definition, and what makes it safe."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

from gimpmd_md.coupling.spline_fit import SplineFit
from gimpmd_schemas.grid.background import BackgroundGrid
from tests.services.md.coupling import dense_fit

SQUARE = BackgroundGrid((0.0, 0.0), 2.0, (12, 12), (False, False))
CUBE = BackgroundGrid((-1.0, 0.0, 2.0), 2.0, (8, 7, 8), (False, False, False))
RING = BackgroundGrid((0.0, 0.0), 2.0, (12, 2), (False, True))


def particles(grid: BackgroundGrid, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """A shell with corners and an inner end, some of its particles heavier."""
    low, high = np.array(grid.box).T
    axes = [np.arange(a + 0.3, b, spacing) for a, b in zip(low, high, strict=True)]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, grid.dim)
    depth = np.min([x - low, high - x], axis=(0, 2))
    x = x[(depth < 7.0) if grid.dim == 2 else (depth < 5.0)]
    return x, 1.0 + 0.5 * (np.arange(len(x)) % 3 == 0)


def fitted(grid: BackgroundGrid, spacing: float) -> tuple[SplineFit, np.ndarray, np.ndarray]:
    x, m = particles(grid, spacing)
    fit = SplineFit(grid, x, m, MPI.COMM_SELF)
    fit.take(x, m)
    return fit, x, m


def matrix(fit: SplineFit, n: int, d: int) -> np.ndarray:
    """R, a column for each particle that moves by itself, along the last axis."""
    columns = []
    for unit in np.eye(n):
        v = np.zeros((n, d))
        v[:, -1] = unit
        columns.append(fit.rest(v)[:, -1])
    return np.array(columns).T


def test_the_rest_is_that_of_the_definition() -> None:
    fit, x, m = fitted(SQUARE, 1.1)
    np.testing.assert_allclose(matrix(fit, len(x), 2), dense_fit.rest(SQUARE, x, m), atol=1e-12)


@pytest.mark.parametrize("grid", [SQUARE, CUBE, RING], ids=["square", "cube", "ring"])
def test_linear_motion_is_fitted_and_forces_have_no_resultant(grid: BackgroundGrid) -> None:
    fit, x, _ = fitted(grid, 1.0)
    rng, d = np.random.default_rng(0), grid.dim
    slope = rng.normal(size=(d, d)) * ~np.array(grid.periodic)[:, None]
    v = x @ slope + rng.normal(size=d)
    assert np.abs(fit.rest(v)).max() < 1e-14 * np.abs(v).max()
    f = fit.spread(rng.normal(size=x.shape))
    assert np.abs(f.sum(axis=0)).max() < 1e-13 * np.abs(f).sum()
    free = np.flatnonzero(~np.array(grid.periodic))
    moments = x[:, free].T @ f
    assert np.abs(moments).max() < 1e-13 * np.abs(x).max() * np.abs(f).sum()


@pytest.mark.parametrize("grid", [SQUARE, CUBE, RING], ids=["square", "cube", "ring"])
def test_forces_spread_by_the_transpose(grid: BackgroundGrid) -> None:
    fit, x, _ = fitted(grid, 1.0)
    f, v = np.random.default_rng(1).normal(size=(2, *x.shape))
    assert (f * fit.rest(v)).sum() == pytest.approx((fit.spread(f) * v).sum(), abs=1e-10)


def test_waves_shorter_than_three_cells_are_left_and_long_ones_are_fitted() -> None:
    """In the middle of a long strip."""
    grid = BackgroundGrid((0.0, 0.0), 2.0, (60, 4), (False, True))
    x = np.stack(np.meshgrid(np.arange(0.25, 120, 0.5), np.arange(0.25, 8, 0.5)), -1).reshape(-1, 2)
    fit = SplineFit(grid, x, np.ones(len(x)), MPI.COMM_SELF)
    fit.take(x, np.ones(len(x)))
    middle = np.abs(x[:, 0] - 60.0) < 12.0
    for cells, low, high in ((2.0, 0.9, 1.1), (3.0, 0.6, 1.0), (8.0, 0.0, 0.01)):
        wave = np.zeros(x.shape)
        wave[:, 0] = np.cos(2.0 * np.pi * x[:, 0] / (2.0 * cells))
        left = fit.rest(wave)[middle, 0]
        assert low <= np.sqrt((left**2).mean() / (wave[middle, 0] ** 2).mean()) <= high

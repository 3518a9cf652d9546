"""Linear hat functions of atoms: lines of nodes, periodic faces, and missing nodes."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_md.coupling.shape_functions import ShapeFunctions, Stencils
from gimpmd_schemas.grid.background import BackgroundGrid

GRID = BackgroundGrid((1.0, -2.0), 2.0, (6, 5), (False, True))
NODES = np.flatnonzero(GRID.canonical())
BLOCK = BackgroundGrid((1.0, -2.0, 0.0), 2.0, (4, 5, 3), (False, True, False))


def stencils_of(functions: ShapeFunctions, x: np.ndarray) -> Stencils:
    """Stencils of atoms that all count, and that touch known nodes only."""
    rows, stencils, stray = functions.marked(np.ones(len(x), dtype=np.int32), 1, x)
    assert stray < 0
    np.testing.assert_array_equal(rows, np.arange(len(x)))
    return stencils


@pytest.mark.parametrize("grid", [GRID, BLOCK])
def test_linear_fields_are_exact_and_sums_are_whole(grid: BackgroundGrid) -> None:
    nodes = np.flatnonzero(grid.canonical())
    cells = np.array(grid.cells) - np.array(grid.periodic)  # away from the end of the period
    x = np.random.default_rng(0).uniform(0.0, cells, (500, grid.dim)) * grid.cell + grid.origin
    stencils = stencils_of(ShapeFunctions(grid, nodes), x)
    gradient = np.random.default_rng(3).normal(size=(grid.dim, grid.dim))
    field = grid.positions()[nodes] @ gradient.T
    np.testing.assert_allclose(stencils.interpolate(field), x @ gradient.T, atol=1e-12)
    values = np.random.default_rng(1).normal(size=x.shape)
    sums = stencils.gather(values, nodes.size)
    np.testing.assert_allclose(sums.sum(axis=0), values.sum(axis=0), atol=1e-12)
    # the transpose of interpolation
    assert (sums * field).sum() == pytest.approx((values * (x @ gradient.T)).sum(), rel=1e-12)


def test_a_period_ends_where_it_begins() -> None:
    field = np.random.default_rng(2).normal(size=(NODES.size, 2))
    functions = ShapeFunctions(GRID, NODES)
    low, high = (
        stencils_of(functions, np.array([[4.3, y]])).interpolate(field) for y in (-2.0, 8.0)
    )
    np.testing.assert_array_equal(low, high)
    between = stencils_of(functions, np.array([[5.0, 7.0]])).interpolate(field)[0]
    ends = [
        np.flatnonzero((GRID.positions()[NODES] == [5.0, y]).all(axis=1))[0] for y in (6.0, -2.0)
    ]
    np.testing.assert_allclose(between, field[ends].mean(axis=0), atol=1e-15)


@pytest.mark.parametrize("off", [0.0, 1e-6, -1e-6])
def test_an_atom_on_a_node_line_needs_no_node_beyond(off: float) -> None:
    """Lattice positions are known to round-off; the region may end on a line of nodes."""
    x = GRID.positions()
    half = np.flatnonzero(GRID.canonical() & (x[:, 0] > 4.0))
    stencils = stencils_of(ShapeFunctions(GRID, half), np.array([[5.0 + off, 1.0]]))
    constant = stencils.interpolate(np.ones((half.size, 2)))
    np.testing.assert_allclose(constant, 1.0, atol=1e-15)


def test_marked_atoms_have_the_stencils_of_their_positions() -> None:
    x = np.random.default_rng(5).uniform([1.0, -2.0], [13.0, 8.0], (50, 2))
    part = np.random.default_rng(6).integers(0, 8, 50).astype(np.int32)
    functions = ShapeFunctions(GRID, NODES)
    places, stencils, stray = functions.marked(part, 2, x)
    assert stray == -1
    np.testing.assert_array_equal(places, [a for a in range(50) if part[a] & 2])
    expected = stencils_of(functions, x[places])
    np.testing.assert_array_equal(stencils.rows, expected.rows)
    np.testing.assert_array_equal(stencils.weights, expected.weights)


def test_an_atom_that_touches_a_missing_node_is_found() -> None:
    half = np.flatnonzero(GRID.canonical() & (GRID.positions()[:, 0] > 4.0))
    functions, x = ShapeFunctions(GRID, half), np.array([[6.0, 1.0], [4.0, 1.0], [4.9, 1.0]])
    assert functions.marked(np.array([0, 0, 1], dtype=np.int32), 1, x)[2] == 2
    assert functions.marked(np.array([1, 0, 0], dtype=np.int32), 1, x)[2] == -1


@pytest.mark.parametrize("grid", [GRID, BLOCK])
def test_averaged_weights_are_means_of_hats(grid: BackgroundGrid) -> None:
    """Over a box as large as a period of the crystal, here up to a cell wide."""
    half = np.array([0.5, 0.37, 0.21])[: grid.dim]
    nodes, n = np.flatnonzero(grid.canonical()), 40
    x = np.random.default_rng(4).uniform(3.0, 6.0, (5, grid.dim))
    places = 2.0 * grid.cell * half * ((np.arange(n)[:, None] + 0.5) / n - 0.5)
    shifts = np.stack(np.meshgrid(*places.T, indexing="ij"), axis=-1).reshape(-1, grid.dim)
    field = np.random.default_rng(6).normal(size=(nodes.size, 2))
    averaged = stencils_of(ShapeFunctions(grid, nodes, half), x).interpolate(field)
    hats = ShapeFunctions(grid, nodes)
    for place, found in zip(x, averaged, strict=True):
        wanted = stencils_of(hats, place + shifts).interpolate(field).mean(axis=0)
        np.testing.assert_allclose(found, wanted, atol=2e-3)

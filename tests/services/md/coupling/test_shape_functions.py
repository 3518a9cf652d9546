"""Linear hat functions of atoms: lines of nodes, periodic faces, and missing nodes."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_md.coupling.shape_functions import ShapeFunctions, Stencils
from gimpmd_md.crystal.inner_shift import InnerShift, shifts, tensors
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


SHIFT = InnerShift(
    np.diag([0.5, 0.4, 0.6]),
    np.zeros(3),
    np.array([[0.0, 0.0, 0.0], [0.25, 0.2, 0.3], [0.1, 0.1, 0.1]]),
    np.concatenate(
        [np.zeros((1, 3, 3, 3)), tensors(np.random.default_rng(4).normal(size=(2, 6, 3)))]
    ),
)
"""A crystal with three atoms in its cell; the first has no inner shift."""


def test_inner_shifts_of_uniform_strain_are_exact_and_forces_go_back_by_the_transpose() -> None:
    nodes = np.flatnonzero(BLOCK.canonical())
    cells = np.array(BLOCK.cells) - np.array(BLOCK.periodic)
    n = np.random.default_rng(5).integers(0, 100, (300, 3)) % (cells * BLOCK.cell / 0.6).astype(int)
    x = np.array(BLOCK.origin) + n @ SHIFT.vectors + SHIFT.basis[np.arange(300) % 3]
    x = x[(x < np.array(BLOCK.origin) + cells * BLOCK.cell).all(axis=1)]
    half = np.array([0.125, 0.1, 0.15])
    functions = ShapeFunctions(BLOCK, nodes, half, SHIFT)
    stencils = stencils_of(functions, x)
    assert stencils.shifted is not None
    kappa = SHIFT.at(x)
    np.testing.assert_array_equal(stencils.shifted.atoms, np.flatnonzero(kappa.any(axis=(1, 2, 3))))
    rng = np.random.default_rng(6)
    H = rng.normal(size=(3, 3))
    inside = (x > 1.5 + np.array(BLOCK.origin)) & (x < np.array(BLOCK.origin) + 2.0 * cells - 1.5)
    inside = inside.all(axis=1)
    moved = stencils.interpolate(BLOCK.positions()[nodes] @ H.T)
    expected = x @ H.T + shifts(kappa, np.broadcast_to(H, (len(x), 3, 3)))
    np.testing.assert_allclose(moved[inside], expected[inside], atol=1e-12)
    field, force = rng.normal(size=(len(nodes), 3)), rng.normal(size=x.shape)
    spread = (stencils.matrix(len(nodes), 3) @ field.ravel()).reshape(x.shape)
    np.testing.assert_allclose(spread, stencils.interpolate(field), atol=1e-12)
    work = (force * stencils.interpolate(field)).sum()
    assert (stencils.gather(force, len(nodes)) * field).sum() == pytest.approx(work, rel=1e-12)
    np.testing.assert_allclose(
        stencils.gather(force, len(nodes)).sum(axis=0), force.sum(axis=0), atol=1e-12
    )

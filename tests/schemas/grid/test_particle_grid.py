"""P2G and G2P against sums over all nodes, in two and three dimensions."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from gimpmd_schemas.grid.background import PAD, BackgroundGrid
from gimpmd_schemas.grid.interpolation import hat, stencil
from gimpmd_schemas.grid.particle_grid import (
    Window,
    gimp_stencils,
    grid_to_particles,
    in_cells,
    linear_stencils,
    particles_to_grid,
    window_of,
)

GRIDS = [
    BackgroundGrid((1.0, -2.0), 0.5, (7, 5), (False, True)),
    BackgroundGrid((1.0, -2.0, 0.0), 0.5, (4, 5, 6), (False, True, False)),
    BackgroundGrid((0.0, 0.0, 0.0), 2.0, (1, 2, 4), (True, True, True)),
]


def particles(grid: BackgroundGrid, n: int = 20) -> tuple[np.ndarray, np.ndarray]:
    """Positions in cells, also up to half a cell outside the domain, and half-widths."""
    rng = np.random.default_rng(grid.size)
    t = rng.uniform(-0.5, np.array(grid.cells) + 0.5, (n, grid.dim))
    t[0] = 1.0  # on a node
    return t, rng.uniform(0.05, 0.5, (n, grid.dim))


def definition(
    grid: BackgroundGrid, t: np.ndarray, half: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Weights ``(n, size)`` and gradients ``(n, size, d)`` as products, node by node."""
    S, dS = np.zeros((len(t), grid.size)), np.zeros((len(t), grid.size, grid.dim))
    images = grid.images()
    for p, position in enumerate(t):
        axes = []
        for axis, x in enumerate(position):
            base, *values = hat(x) if half is None else stencil(x, half[p, axis])
            width = 2 if half is None else 3
            axes.append([(base + k, *values[k::width]) for k in range(width)])
        for nodes in itertools.product(*axes):
            index = [node[0] + PAD for node in nodes]
            place = images[np.ravel_multi_index(index, grid.shape)]
            S[p, place] += np.prod([node[1] for node in nodes])
            for axis in range(grid.dim if half is not None else 0):
                factors = [node[2 if a == axis else 1] for a, node in enumerate(nodes)]
                dS[p, place, axis] += np.prod(factors) / grid.cell
    return S, dS


@pytest.mark.parametrize("grid", GRIDS)
def test_gimp_stencils_are_products_of_the_weights_along_the_axes(grid: BackgroundGrid) -> None:
    t, half = particles(grid)
    S, dS = definition(grid, t, half)
    nodes, weights, gradients = gimp_stencils(t, half, grid.cell, window_of(grid))
    assert nodes.shape == weights.shape == (len(t), 3**grid.dim)
    assert gradients.shape == (len(t), 3**grid.dim, grid.dim)
    found, slopes = np.zeros_like(S), np.zeros_like(dS)
    for p in range(len(t)):
        np.add.at(found[p], nodes[p], weights[p])
        np.add.at(slopes[p], nodes[p], gradients[p])
    np.testing.assert_allclose(found, S, atol=1e-15)
    np.testing.assert_allclose(slopes, dS, atol=1e-13)
    assert grid.canonical()[nodes].all()


@pytest.mark.parametrize("grid", GRIDS)
def test_both_directions_are_sums_over_all_nodes(grid: BackgroundGrid) -> None:
    t, half = particles(grid)
    window = window_of(grid)
    rng = np.random.default_rng(3)
    q, Q = rng.normal(size=(len(t), 4)), rng.normal(size=(grid.size, 4))
    for S, stencils in (
        (definition(grid, t, half)[0], gimp_stencils(t, half, grid.cell, window)[:2]),
        (definition(grid, t, None)[0], linear_stencils(t, window)),
    ):
        sums, values = np.zeros_like(Q), np.full_like(q, np.nan)
        particles_to_grid(*stencils, q, sums)
        grid_to_particles(*stencils, Q, values)
        np.testing.assert_allclose(sums, S.T @ q, atol=1e-13)
        np.testing.assert_allclose(values, S @ Q, atol=1e-13)


@pytest.mark.parametrize("grid", GRIDS[:2])
def test_linear_fields_are_exact(grid: BackgroundGrid) -> None:
    """Inside, where no stencil crosses a periodic face."""
    rng = np.random.default_rng(4)
    x = np.array(grid.origin) + grid.cell * rng.uniform(
        1.0, np.array(grid.cells) - 1.5, (50, grid.dim)
    )
    t, gradient = in_cells(grid, x), rng.normal(size=(2, grid.dim))
    field, exact = grid.positions() @ gradient.T, x @ gradient.T
    nodes, S, dS = gimp_stencils(t, np.full_like(t, 0.3), grid.cell, window_of(grid))
    for stencils in ((nodes, S), linear_stencils(t, window_of(grid))):
        values = np.empty_like(exact)
        grid_to_particles(*stencils, field, values)
        np.testing.assert_allclose(values, exact, atol=1e-13)
    slopes = np.einsum("pik,pij->pkj", field[nodes], dS)
    np.testing.assert_allclose(slopes, np.broadcast_to(gradient, slopes.shape), atol=1e-12)


def test_a_window_numbers_its_nodes_in_C_order() -> None:
    window = Window(first=(3, 0, -1), shape=(4, 5, 6), period=(0, 5, 0))
    nodes, S = linear_stencils(np.array([[4.0, 4.25, 2.0]]), window)
    corner = (1 * 5 + 4) * 6 + 3
    assert nodes[0, 0] == corner
    assert nodes[0, 1] == corner + 1
    assert nodes[0, 2] == (1 * 5 + 0) * 6 + 3  # index 5 is the image of index 0
    assert S[0].tolist() == [0.75, 0.0, 0.25, 0.0, 0.0, 0.0, 0.0, 0.0]

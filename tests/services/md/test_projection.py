"""Atoms to nodes and back."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_md.projection import NodeMap, interpolate, project
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid import BackgroundGrid

SPACING = 1.0359505


def no_neighbours(field: np.ndarray) -> None:
    """One patch alone: sums are complete."""


def crystal(width: float, height: float) -> np.ndarray:
    a = 1.1132013
    rows = int(height / (a * 3**0.5 / 2))
    x = np.array(
        [
            ((i + 0.5 * (j % 2) + 0.25) * a, (j + 0.5) * a * 3**0.5 / 2)
            for j in range(rows)
            for i in range(int(width / a))
        ]
    )
    return x[x[:, 0] < width]


@pytest.fixture
def grid() -> BackgroundGrid:
    return BackgroundGrid((0.0, 0.0), 4.0, (15, 12), (False, False))


@pytest.fixture
def nodes(grid: BackgroundGrid) -> NodeMap:
    return NodeMap(grid, np.arange(grid.size), SPACING)


@pytest.fixture
def atoms() -> np.ndarray:
    return crystal(60.0, 48.0)


def test_weights_sum_to_one_and_reproduce_linear_fields(
    grid: BackgroundGrid, nodes: NodeMap, atoms: np.ndarray
) -> None:
    weights = nodes.weights(atoms)
    np.testing.assert_allclose(weights.S.sum(axis=1), 1.0, atol=1e-14)
    gradient = np.array([[0.01, -0.02], [0.03, 0.04]])
    found = interpolate(weights, grid.positions() @ gradient.T)
    np.testing.assert_allclose(found, atoms @ gradient.T, atol=1e-12)


def test_mass_and_momentum_are_exact(
    grid: BackgroundGrid, nodes: NodeMap, atoms: np.ndarray
) -> None:
    generator = np.random.default_rng(1)
    m = generator.uniform(0.5, 2.0, atoms.shape[0])
    q = generator.normal(size=atoms.shape)
    mass, momentum, _ = project(nodes.weights(atoms), m, q, grid.size, no_neighbours)
    assert mass.sum() == pytest.approx(m.sum(), rel=1e-13)
    np.testing.assert_allclose(momentum.sum(axis=0), m @ q, rtol=1e-11, atol=1e-11)


def test_linear_velocity_is_reproduced_inside(
    grid: BackgroundGrid, nodes: NodeMap, atoms: np.ndarray
) -> None:
    gradient = np.array([[0.01, -0.02], [0.03, 0.04]])
    q = atoms @ gradient.T
    _, _, velocity = project(nodes.weights(atoms), np.ones(len(atoms)), q, grid.size, no_neighbours)
    x = grid.positions()
    deep = ((x > 16.0) & (x < [44.0, 32.0])).all(axis=1)
    # the lattice is not symmetric about a node: the sums of a stencil are off by a part of spacing
    error = np.abs(velocity - x @ gradient.T)[deep].max()
    assert error < 0.02 * np.abs(gradient).max() * grid.cell


@pytest.mark.parametrize("wavelength", [8.0, 12.0, 20.0])
def test_consistent_projection_keeps_waves_that_lumped_weakens(
    grid: BackgroundGrid, nodes: NodeMap, atoms: np.ndarray, wavelength: float
) -> None:
    """One lumped projection and interpolation multiply a wave by about sinc^2(k h / 2)^2."""
    wave = np.sin(2.0 * np.pi * atoms[:, 0] / (wavelength * grid.cell))
    q = np.column_stack([wave, 0.0 * wave])
    weights, m = nodes.weights(atoms), np.ones(len(atoms))
    mass, momentum, velocity = project(weights, m, q, grid.size, no_neighbours)
    lumped = np.divide(
        momentum, mass[:, None], out=np.zeros_like(momentum), where=mass[:, None] > 0
    )
    deep = (atoms[:, 0] > 12.0) & (atoms[:, 0] < 48.0) & (atoms[:, 1] > 12.0) & (atoms[:, 1] < 36.0)

    def rest(field: np.ndarray) -> float:
        return float(np.abs(interpolate(weights, field)[deep, 0] - wave[deep]).max())

    assert rest(velocity) < 0.35 * rest(lumped)


def test_images_fold_onto_the_node_they_repeat() -> None:
    grid = BackgroundGrid((0.0, 0.0), 4.0, (15, 12), (False, True))
    nodes = NodeMap(grid, np.flatnonzero(grid.canonical()), SPACING)
    x = np.array([[30.0, 0.3], [30.0, 47.9], [30.0, 48.3], [30.0, -0.1]])
    weights = nodes.weights(x)
    np.testing.assert_array_equal(weights.nodes[0], weights.nodes[2])
    np.testing.assert_allclose(weights.S[0], weights.S[2], atol=1e-12)
    np.testing.assert_allclose(weights.S[1], weights.S[3], atol=1e-12)


def test_a_stray_atom_is_an_error(grid: BackgroundGrid, nodes: NodeMap) -> None:
    with pytest.raises(BackendError, match=r"\(70, 3\) has left the background grid"):
        nodes.weights(np.array([[3.0, 3.0], [70.0, 3.0]]))
    with pytest.raises(BackendError, match="left the background grid"):
        nodes.weights(np.array([[3.0, np.nan]]))
    few = NodeMap(grid, np.arange(grid.size // 2), SPACING)
    with pytest.raises(BackendError, match="too far outside its patch"):
        few.weights(np.array([[55.0, 3.0]]))

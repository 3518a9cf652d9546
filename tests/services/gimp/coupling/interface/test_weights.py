"""Weights of nodes at places, along segments and at material points."""

from __future__ import annotations

import numpy as np

from gimpmd_gimp.coupling.interface.weights import averages, gradients, hats, means
from gimpmd_schemas.grid.background import BackgroundGrid
from tests.physics.lattice import SPACING
from tests.services.gimp.coupling.interface.crystal_bodies import ROWS, make_body

A, PAIR = SPACING, 2.0 * ROWS


def test_means_are_integrals():
    grid = BackgroundGrid((1.0, -2.0), 1.7, (6, 5), (False, True))
    start = np.array([[2.0, 0.3], [2.0, 0.3], [9.9, 1.0], [4.4, 4.0]])
    end = np.array([[9.3, 0.3], [2.0, 0.3], [9.9, 1.1], [4.4, 9.2]])  # the last one wraps
    t = (np.arange(200000) + 0.5) / 200000
    x = grid.positions()
    for row, (a, b) in enumerate(zip(start, end, strict=True)):
        expected = np.zeros(grid.size)
        place = a + t[:, None] * (b - a)
        for node, image in enumerate(grid.images()):
            hat = np.clip(1.0 - np.abs(place - x[node]) / grid.cell, 0.0, None).prod(axis=1).mean()
            expected[image] += hat
        found, keep = means(grid, start, end).toarray()[row], grid.canonical()
        assert found[~keep].max() == 0.0
        np.testing.assert_allclose(found[keep], expected[keep], atol=1e-9)


def test_averages_over_a_side_of_a_box_are_means_along_it() -> None:
    grid = BackgroundGrid((0.0, 0.0), 0.5, (6, 5), (False, True))
    x = np.array([[1.0, 0.6], [0.0, 2.4]])
    half = np.array([[1e-14, 0.3], [1e-14, 0.25]])
    along = np.array([0.0, 1.0]) * half[:, 1:] * grid.cell
    expected = means(grid, x - along, x + along)
    np.testing.assert_allclose(averages(grid, x, half).toarray(), expected.toarray(), atol=1e-13)


def test_gradients_add_up_to_zero_and_are_exact_for_linear_fields():
    body = make_body(4.0, (15, 15), ((16 * A, 36 * A), (9 * PAIR, 19 * PAIR)))
    x = body.grid.positions()
    for axis, by in enumerate(gradients(body.grid, body.points.reference, body.points.half)):
        np.testing.assert_allclose(by.sum(axis=1), 0.0, atol=1e-14)
        np.testing.assert_allclose(by @ x, np.tile(np.eye(2)[axis], (by.shape[0], 1)), atol=1e-12)


def test_weights_in_a_block() -> None:
    """Linear fields are exact; segments across a periodic face count for the nodes within."""
    grid = BackgroundGrid((1.0, -2.0, 0.5), 0.5, (6, 5, 4), (False, False, True))
    low, high = np.array(grid.origin) + 0.5, np.array(grid.origin) + 0.5 * np.array(grid.cells) - 1
    start = np.random.default_rng(0).uniform(low, high, (30, 3))
    end = start.copy()
    end[:, 1] += np.linspace(0.0, 0.5, 30)
    x = grid.positions()
    np.testing.assert_allclose(hats(grid, start) @ x, start, atol=1e-13)
    np.testing.assert_allclose(means(grid, start, end) @ x, 0.5 * (start + end), atol=1e-13)
    half = np.full_like(start, 0.4)
    for axis, by in enumerate(gradients(grid, start, half)):
        np.testing.assert_allclose(by @ x, np.tile(np.eye(3)[axis], (30, 1)), atol=1e-12)
    across = means(grid, np.array([[2.0, -1.0, 2.0]]), np.array([[2.0, -1.0, 3.0]])).tocoo()
    assert grid.canonical()[across.coords[1]].all()
    along_z = np.zeros(4)
    np.add.at(along_z, np.rint((x[across.coords[1], 2] - 0.5) / 0.5).astype(int), across.data)
    np.testing.assert_allclose(along_z, [0.5, 0.25, 0.0, 0.25])

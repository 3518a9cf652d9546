"""Vectors in registers against numpy, in one, two and three dimensions."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from gimpmd_gimp.sweeps.simd import (
    at,
    contract,
    deposit,
    deposit_row,
    diagonal,
    floor,
    join,
    load,
    load_row,
    maximum,
    minimum,
    outer,
    part,
    store,
    zero,
    zero_row,
)

DIMS = [1, 2, 3]


@njit
def _arithmetic(axes, a, b, out):
    u, v = load(axes, a, 1), load(axes, b, 2)
    store(out, 0, u + v)
    store(out, 1, u - 2.0 * v)
    store(out, 2, 1.0 / u)
    store(out, 3, u * v / 3.0)
    store(out, 4, minimum(u, v))
    store(out, 5, maximum(u, 0.25))
    store(out, 6, floor(4.0 * v))
    deposit(out, 7, u)
    deposit(out, 7, v)
    store(out, 8, zero(axes) + u[0])


@pytest.mark.parametrize("d", DIMS)
def test_arithmetic_is_by_component(d) -> None:
    """Vectors are counted through an array of any shape; those beside stay as they are."""
    rng = np.random.default_rng(d)
    a, b = rng.normal(size=(4, d)), rng.normal(size=(2, 2, d))
    out = np.full((10, d), 7.0)
    _arithmetic((0,) * d, a, b, out)
    u, v = a[1], b[1, 0]
    expected = [u + v, u - 2.0 * v, 1.0 / u, u * v / 3.0, np.minimum(u, v), np.maximum(u, 0.25)]
    expected += [np.floor(4.0 * v), 7.0 + u + v, np.full(d, u[0]), np.full(d, 7.0)]
    np.testing.assert_allclose(out, expected, rtol=1e-15)


@njit
def _rows(axes, a, w, out, rows):
    row, weights = load_row(axes, a, 1), (w[0], w[1], w[2])
    store(out, 0, part(row, 0))
    store(out, 1, part(row, 1))
    store(out, 2, part(row, 2))
    store(out, 3, contract(weights, row))
    u = load(axes, a, 0)
    deposit_row(rows, 1, outer(weights, u))
    deposit_row(rows, 1, join(part(row, 2), u, part(row, 0)) * 2.0)
    deposit_row(rows, 4, zero_row(axes) + 1.0)


@pytest.mark.parametrize("d", DIMS)
def test_rows_are_three_vectors_beside_each_other(d) -> None:
    rng = np.random.default_rng(d)
    a, w = rng.normal(size=(5, d)), rng.normal(size=3)
    out, rows = np.zeros((4, d)), rng.normal(size=(8, d))
    expected = rows.copy()
    _rows((0,) * d, a, w, out, rows)
    np.testing.assert_array_equal(out[:3], a[1:4])
    np.testing.assert_allclose(out[3], w @ a[1:4], rtol=1e-14)
    expected[1:4] += np.outer(w, a[0]) + 2.0 * np.stack([a[3], a[0], a[1]])
    expected[4:7] += 1.0
    np.testing.assert_allclose(rows, expected, rtol=1e-14)


@njit
def _reads(axes, F, whole, out):
    store(out, 0, diagonal(axes, F, 2))
    store(out, 1, zero(axes) + float(at(whole, 3)))


@pytest.mark.parametrize("d", DIMS)
def test_diagonals_and_single_numbers(d) -> None:
    F = np.random.default_rng(d).normal(size=(3, d, d))
    out = np.zeros((2, d))
    _reads((0,) * d, F, np.arange(10, 20), out)
    np.testing.assert_array_equal(out[0], np.diag(F[2]))
    np.testing.assert_array_equal(out[1], 13.0)

"""Which nodes of the shared grid move a place, a stretch of a plane, or a material point.

All weights are rows of sparse matrices whose columns are the ids of the grid's nodes; what falls
on a periodic image counts for the node that it repeats.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from scipy import sparse

from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.grid.background import PAD, BackgroundGrid
from gimpmd_schemas.grid.interpolation import stencil

Sparse = Any
"""A matrix in scipy's compressed sparse row format."""

Axis = tuple[Ints, Floats]
"""Nodes along one axis and their weights, both of shape ``(n, k)``."""


def hats(grid: BackgroundGrid, x: Floats) -> Sparse:
    """Bilinear hat functions at positions, ``(n, 2)``; shape ``(n, grid.size)``."""
    t = _in_cells(grid, x)
    return _product(grid, _means(t[:, 0], t[:, 0]), _means(t[:, 1], t[:, 1]))


def means(grid: BackgroundGrid, start: Floats, end: Floats) -> Sparse:
    """Hat functions averaged along segments parallel to an axis, exactly.

    Parameters
    ----------
    start, end : ndarray, shape ``(n, 2)``
        Ends of the segments, which differ along one axis only, ``start <= end``. Where they
        coincide, the average is the value there.
    """
    a, b = _in_cells(grid, start), _in_cells(grid, end)
    return _product(grid, _means(a[:, 0], b[:, 0]), _means(a[:, 1], b[:, 1]))


def gradients(grid: BackgroundGrid, reference: Floats, half: Floats) -> tuple[Sparse, Sparse]:
    """Gradients of the points' weights by x and by y (paper Eq. 14), per length.

    Parameters
    ----------
    reference, half : ndarray, shape ``(n, 2)``
        Of points on the finest level (length; cells).
    """
    t, n = _in_cells(grid, reference), reference.shape[0]
    axes: list[tuple[Axis, Axis]] = []
    for axis in range(2):
        base, s, g = np.empty((n, 1), np.int64), np.empty((n, 3)), np.empty((n, 3))
        _stencils(t[:, axis], half[:, axis], base, s, g)
        nodes = base + np.arange(3)
        axes.append(((nodes, s), (nodes, g / grid.cell)))
    (x, by_x), (y, by_y) = axes
    return _product(grid, by_x, y), _product(grid, x, by_y)


@njit(cache=True)
def _stencils(t: Floats, half: Floats, base: Ints, s: Floats, g: Floats) -> None:
    for p in range(t.size):
        first, s0, s1, s2, g0, g1, g2 = stencil(t[p], half[p])
        base[p, 0] = first
        s[p, 0], s[p, 1], s[p, 2] = s0, s1, s2
        g[p, 0], g[p, 1], g[p, 2] = g0, g1, g2


def _in_cells(grid: BackgroundGrid, x: Floats) -> Floats:
    return (x - np.asarray(grid.origin)) / grid.cell


def _means(a: Floats, b: Floats) -> Axis:
    """Mean of the one-dimensional hats from a to b: between node lines the middle is exact."""
    first = np.floor(a)
    pieces = int(np.max(np.ceil(b) - first, initial=1.0))
    weights = np.zeros((a.size, pieces + 1))
    length = b - a
    for k in range(pieces):
        low, high = np.maximum(a, first + k), np.minimum(b, first + k + 1)
        share = np.maximum(high - low, 0.0) / np.where(length > 0.0, length, 1.0)
        if k == 0:
            share = np.where(length > 0.0, share, 1.0)
        right = 0.5 * (low + high) - first - k
        weights[:, k] += share * (1.0 - right)
        weights[:, k + 1] += share * right
    return first[:, None].astype(np.int64) + np.arange(pieces + 1), weights


def _product(grid: BackgroundGrid, x: Axis, y: Axis) -> Sparse:
    """Rows of products of weights along both axes."""
    columns = []
    for axis, (nodes, _) in enumerate((x, y)):
        columns.append((nodes % grid.cells[axis] if grid.periodic[axis] else nodes) + PAD)
    weight = x[1][:, :, None] * y[1][:, None, :]
    column = columns[0][:, :, None] * grid.shape[1] + columns[1][:, None, :]
    row = np.broadcast_to(np.arange(weight.shape[0])[:, None, None], weight.shape)
    used = weight != 0.0
    shape = (weight.shape[0], grid.size)
    return sparse.coo_array((weight[used], (row[used], column[used])), shape=shape).tocsr()

"""Weights of the background grid's nodes at places, along segments, and at material points.

All weights are rows of sparse matrices whose columns are the ids of the grid's nodes. The weight of
a periodic image counts for the node that it repeats.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse

from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.grid.background import PAD, BackgroundGrid
from gimpmd_schemas.grid.particle_grid import gimp_stencils, in_cells, linear_stencils, window_of

Sparse = Any
"""A matrix in scipy's compressed sparse row format."""


def hats(grid: BackgroundGrid, x: Floats) -> Sparse:
    """Linear hat functions at positions ``x``, shape ``(n, d)``.

    Returns
    -------
    sparse matrix, shape ``(n, grid.size)``
    """
    return _matrix(grid, *linear_stencils(in_cells(grid, x), window_of(grid)))


def means(grid: BackgroundGrid, start: Floats, end: Floats) -> Sparse:
    """Exact averages of the linear hat functions along segments parallel to an axis.

    Parameters
    ----------
    start, end : ndarray, shape ``(n, d)``
        Ends of the segments, which differ along one axis only, ``start <= end``. Where they
        coincide, the average is the value there.

    Returns
    -------
    sparse matrix, shape ``(n, grid.size)``
    """
    a, b = in_cells(grid, start), in_cells(grid, end)
    nodes, weights = np.zeros((len(a), 1), dtype=np.int64), np.ones((len(a), 1))
    for axis, n in enumerate(grid.shape):
        index, weight = _axis_means(a[:, axis], b[:, axis])
        place = (index % grid.cells[axis] if grid.periodic[axis] else index) + PAD
        nodes = (nodes[:, :, None] * n + place[:, None, :]).reshape(len(a), -1)
        weights = (weights[:, :, None] * weight[:, None, :]).reshape(len(a), -1)
    return _matrix(grid, nodes, weights)


def averages(grid: BackgroundGrid, x: Floats, half: Floats) -> Sparse:
    """Exact averages of the linear hat functions over boxes of at most one cell.

    Parameters
    ----------
    x : ndarray, shape ``(n, d)``
        Middles (length).
    half : ndarray, shape ``(n, d)``
        Half-widths in cells, more than zero.

    Returns
    -------
    sparse matrix, shape ``(n, grid.size)``
    """
    nodes, weights, _ = gimp_stencils(in_cells(grid, x), half, grid.cell, window_of(grid))
    return _matrix(grid, nodes, weights)


def gradients(grid: BackgroundGrid, reference: Floats, half: Floats) -> tuple[Sparse, ...]:
    """Gradients of the weights of material points (paper Eq. 14), per length.

    Parameters
    ----------
    reference : ndarray, shape ``(n, d)``
        Reference positions of points on the finest level (length).
    half : ndarray, shape ``(n, d)``
        Their half-widths in cells.

    Returns
    -------
    tuple of sparse matrix, shape ``(n, grid.size)``
        One matrix for each component of the gradient.
    """
    window = window_of(grid)
    nodes, _, slopes = gimp_stencils(in_cells(grid, reference), half, grid.cell, window)
    return tuple(_matrix(grid, nodes, slopes[:, :, axis]) for axis in range(grid.dim))


def _axis_means(a: Floats, b: Floats) -> tuple[Ints, Floats]:
    """Nodes along one axis, and the means of their hat functions from a to b; shape ``(n, k)``.

    A hat function is linear between two nodes, so its mean there is its value in the middle.
    """
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


def _matrix(grid: BackgroundGrid, nodes: Ints, weights: Floats) -> Sparse:
    """Rows of weights, both of shape ``(n, k)``; zero weights are left out."""
    row = np.broadcast_to(np.arange(len(nodes))[:, None], nodes.shape)
    used = weights != 0.0
    shape = (len(nodes), grid.size)
    return sparse.coo_array((weights[used], (row[used], nodes[used])), shape=shape).tocsr()

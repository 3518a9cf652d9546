"""Sums at cubic B-splines and back, over particles that are sorted by the cells of the splines.

A particle touches four splines along each axis, so the particles of a cell touch the same block of
``4^d`` splines, and a sum over a cell is a product of two small matrices. The number of terms is
one, or ``d + 1`` for the value and its products with the position relative to the spline, in
spacings of the splines.
"""

from __future__ import annotations

import numpy as np

from gimpmd_schemas.compiled import njit


@njit(cache=True)
def weights(t):  # type: ignore[no-untyped-def]
    """Lowest of the four splines along each axis, place in the cell, and weights.

    Parameters
    ----------
    t : ndarray, shape ``(n, d)``
        Positions in spacings of the splines, from spline 0.

    Returns
    -------
    ndarray of int64, shape ``(n, d)``; ndarray, shape ``(n, d)``, in -1/2 .. 1/2; ndarray, shape
    ``(n, d, 4)``
    """
    n, d = t.shape
    low, place, w = np.empty((n, d), np.int64), np.empty((n, d)), np.empty((n, d, 4))
    for a in range(n):
        for axis in range(d):
            cell = np.floor(t[a, axis])
            s = t[a, axis] - cell
            low[a, axis], place[a, axis] = int(cell) - 1, s - 0.5
            w[a, axis, 0] = (1.0 - s) ** 3 / 6.0
            w[a, axis, 1] = 2.0 / 3.0 - s * s * (1.0 - 0.5 * s)
            w[a, axis, 3] = s**3 / 6.0
            w[a, axis, 2] = 1.0 - w[a, axis, 0] - w[a, axis, 1] - w[a, axis, 3]
    return low, place, w


@njit(cache=True)
def sums(order, start, block, place, w, values, terms, out):  # type: ignore[no-untyped-def]
    """Add ``sum_a N_ja values_a``, and with more terms those with ``x_a - X_j``, to ``out``.

    Parameters
    ----------
    order : ndarray of int64, shape ``(n,)``
        Rows of the particles in ``values``, cell by cell.
    start : ndarray of int64, shape ``(cells + 1,)``
    block : ndarray of int64, shape ``(cells, 4^d)``
        Rows of the splines of each cell.
    place, w : see `weights`, in the order of the cells.
    values : ndarray, shape ``(particles, k)``
    terms : int
        1 or d + 1.
    out : ndarray, shape ``(splines, terms, k)``
    """
    d, k = place.shape[1], values.shape[1]
    most = _most(start)
    N, each = np.empty((most, 4**d)), np.empty((most, terms * k))
    for cell in range(len(start) - 1):
        first, n = start[cell], start[cell + 1] - start[cell]
        _products(w[first : first + n], N)
        for i in range(n):
            a = order[first + i]
            for c in range(k):
                each[i, c] = values[a, c]
                for axis in range(terms - 1):
                    each[i, (axis + 1) * k + c] = place[first + i, axis] * values[a, c]
        sums_of_cell = np.dot(N[:n].T, each[:n])
        for j in range(4**d):
            row = block[cell, j]
            for c in range(k):
                out[row, 0, c] += sums_of_cell[j, c]
                for axis in range(terms - 1):
                    moved = _away(j, axis, d) * sums_of_cell[j, c]
                    out[row, axis + 1, c] += sums_of_cell[j, (axis + 1) * k + c] + moved


@njit(cache=True)
def interpolate(order, start, block, place, w, field, out):  # type: ignore[no-untyped-def]
    """Set ``out_a`` to ``sum_j N_ja field_j``, or to that of linear functions around the splines.

    Parameters
    ----------
    order, start, block, place, w : see `sums`.
    field : ndarray, shape ``(splines, terms, k)``
        Values and, with ``d + 1`` terms, slopes.
    out : ndarray, shape ``(particles, k)``
    """
    d, terms, k = place.shape[1], field.shape[1], field.shape[2]
    N, near = np.empty((_most(start), 4**d)), np.empty((4**d, terms * k))
    for cell in range(len(start) - 1):
        first, n = start[cell], start[cell + 1] - start[cell]
        for j in range(4**d):
            row = block[cell, j]
            for c in range(k):
                near[j, c] = field[row, 0, c]
                for axis in range(terms - 1):
                    slope = field[row, axis + 1, c]
                    near[j, (axis + 1) * k + c] = slope
                    near[j, c] += _away(j, axis, d) * slope
        _products(w[first : first + n], N)
        each = np.dot(N[:n], near)
        for i in range(n):
            for c in range(k):
                value = each[i, c]
                for axis in range(terms - 1):
                    value += place[first + i, axis] * each[i, (axis + 1) * k + c]
                out[order[first + i], c] = value


@njit(cache=True)
def _most(start):  # type: ignore[no-untyped-def]
    """Particles in the fullest cell."""
    most = 0
    for cell in range(len(start) - 1):
        most = max(most, start[cell + 1] - start[cell])
    return most


@njit(cache=True)
def _products(w, N):  # type: ignore[no-untyped-def]
    """Weights of particles on the ``4^d`` splines of their cell."""
    for i in range(len(w)):
        for p in range(4):
            for q in range(4):
                if w.shape[1] == 2:
                    N[i, 4 * p + q] = w[i, 0, p] * w[i, 1, q]
                else:
                    outer = w[i, 0, p] * w[i, 1, q]
                    for r in range(4):
                        N[i, 16 * p + 4 * q + r] = outer * w[i, 2, r]


@njit(inline="always")
def _away(number, axis, d):  # type: ignore[no-untyped-def]
    """From a spline of the block to the middle of the cell, along an axis."""
    return 1.5 - (number // 4 ** (d - 1 - axis)) % 4

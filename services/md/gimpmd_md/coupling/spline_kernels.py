"""Sums at cubic B-splines and back, over particles that are sorted by the cells of the splines.

A particle touches four splines along each axis, so the particles of a cell touch the same block of
``4^d`` splines. Sums over a cell stay in the processor's cache, four splines at a time. The number
of terms is one, or ``d + 1`` for the value and its products with the position relative to the
spline, in spacings of the splines.
"""

from __future__ import annotations

import numpy as np
from numba import njit


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
    outer = 4 ** (d - 1)
    acc, o, each = np.empty((terms * k, outer, 4)), np.empty(outer), np.empty(terms * k)
    for cell in range(len(start) - 1):
        acc[:] = 0.0
        for i in range(start[cell], start[cell + 1]):
            _outer_weights(w[i], o)
            for c in range(k):
                each[c] = values[order[i], c]
                for axis in range(terms - 1):
                    each[(axis + 1) * k + c] = place[i, axis] * each[c]
            w0, w1, w2, w3 = w[i, d - 1, 0], w[i, d - 1, 1], w[i, d - 1, 2], w[i, d - 1, 3]
            for q in range(terms * k):
                for p in range(outer):
                    s = o[p] * each[q]
                    acc[q, p, 0] += s * w0
                    acc[q, p, 1] += s * w1
                    acc[q, p, 2] += s * w2
                    acc[q, p, 3] += s * w3
        for p in range(outer):
            for j in range(4):
                row = block[cell, 4 * p + j]
                for c in range(k):
                    out[row, 0, c] += acc[c, p, j]
                    for axis in range(terms - 1):
                        away = _away(4 * p + j, axis, d)
                        out[row, axis + 1, c] += acc[(axis + 1) * k + c, p, j] + away * acc[c, p, j]


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
    outer = 4 ** (d - 1)
    near, o, each = np.empty((terms * k, outer, 4)), np.empty(outer), np.empty(terms * k)
    for cell in range(len(start) - 1):
        for p in range(outer):
            for j in range(4):
                row = block[cell, 4 * p + j]
                for c in range(k):
                    near[c, p, j] = field[row, 0, c]
                    for axis in range(terms - 1):
                        slope = field[row, axis + 1, c]
                        near[(axis + 1) * k + c, p, j] = slope
                        near[c, p, j] += _away(4 * p + j, axis, d) * slope
        for i in range(start[cell], start[cell + 1]):
            _outer_weights(w[i], o)
            w0, w1, w2, w3 = w[i, d - 1, 0], w[i, d - 1, 1], w[i, d - 1, 2], w[i, d - 1, 3]
            for q in range(terms * k):
                s0 = s1 = s2 = s3 = 0.0
                for p in range(outer):
                    s0 += o[p] * near[q, p, 0]
                    s1 += o[p] * near[q, p, 1]
                    s2 += o[p] * near[q, p, 2]
                    s3 += o[p] * near[q, p, 3]
                each[q] = s0 * w0 + s1 * w1 + s2 * w2 + s3 * w3
            for c in range(k):
                value = each[c]
                for axis in range(terms - 1):
                    value += place[i, axis] * each[(axis + 1) * k + c]
                out[order[i], c] = value


@njit(inline="always")
def _outer_weights(w, o):  # type: ignore[no-untyped-def]
    """Products of the weights along all axes but the last."""
    for p in range(4):
        if len(o) == 4:
            o[p] = w[0, p]
        else:
            for q in range(4):
                o[4 * p + q] = w[0, p] * w[1, q]


@njit(inline="always")
def _away(number, axis, d):  # type: ignore[no-untyped-def]
    """From a spline of the block to the middle of the cell, along an axis."""
    return 1.5 - (number // 4 ** (d - 1 - axis)) % 4

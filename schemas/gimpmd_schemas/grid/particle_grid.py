"""Particle to grid (P2G) and grid to particle (G2P), in two or three dimensions.

A particle is an atom or a material point. Its *stencil* lists the nodes that it touches, by their
place in flat nodal arrays, with their weights ``S_ip`` and, where needed, the gradients of the
weights. Both directions use the same stencil, so each is the transpose of the other:

    P2G:  Q_i += S_ip q_p        G2P:  q_p = sum_i S_ip Q_i

The nodes of a stencil are in C order: the last axis varies fastest.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.compiled import njit
from gimpmd_schemas.grid.background import PAD, BackgroundGrid
from gimpmd_schemas.grid.interpolation import hat, stencil


class Window(NamedTuple):
    """The nodes of a nodal array, which is flat and in C order.

    Attributes
    ----------
    first : tuple of int
        Index of the first node along each axis.
    shape : tuple of int
        Number of nodes along each axis.
    period : tuple of int
        Number of cells after which the grid repeats along each axis, or 0 where it does not. The
        nodes with indices ``0`` to ``period - 1`` stand for all their images.
    """

    first: tuple[int, ...]
    shape: tuple[int, ...]
    period: tuple[int, ...]


def window_of(grid: BackgroundGrid) -> Window:
    """Describe the padded nodal arrays of a grid, in which sums go to the canonical nodes."""
    period = tuple(n if p else 0 for n, p in zip(grid.cells, grid.periodic, strict=True))
    return Window((-PAD,) * grid.dim, grid.shape, period)


def in_cells(grid: BackgroundGrid, x: Floats) -> Floats:
    """Convert positions ``(n, d)`` to cells from the origin of the grid."""
    return np.asarray((x - np.asarray(grid.origin)) / grid.cell)


# --- one particle: building blocks for kernels ------------------------------------------------
#
# Loops run over the first, the middle and the last axis. In two dimensions the middle axis is a
# single node of weight one. The number of dimensions is the length of a tuple, which is known when
# a kernel is compiled; so the loops over the nodes unroll.


@njit(inline="always")
def gimp_weights(t, half, d):  # type: ignore[no-untyped-def]
    """Evaluate the weights of a particle along the first, the middle and the last axis.

    Parameters
    ----------
    t, half : ndarray, shape ``(d,)``
        Position and half-widths in cells.
    d : int

    Returns
    -------
    base : tuple of three int
        Index of the first node along each of these axes.
    first, middle, last : tuple of three float
        Weights along each of these axes.
    """
    i, a0, a1, a2, _, _, _ = stencil(t[0], half[0])
    k, c0, c1, c2, _, _, _ = stencil(t[d - 1], half[d - 1])
    j, b0, b1, b2 = 0, 1.0, 0.0, 0.0
    if d == 3:
        j, b0, b1, b2, _, _, _ = stencil(t[1], half[1])
    return (i, j, k), (a0, a1, a2), (b0, b1, b2), (c0, c1, c2)


@njit(inline="always")
def linear_weights(t, d):  # type: ignore[no-untyped-def]
    """Evaluate the weights of the linear hat functions; see ``gimp_weights``."""
    i, a0, a1 = hat(t[0])
    k, c0, c1 = hat(t[d - 1])
    j, b0, b1 = 0, 1.0, 0.0
    if d == 3:
        j, b0, b1 = hat(t[1])
    return (i, j, k), (a0, a1), (b0, b1), (c0, c1)


@njit(inline="always")
def place_of(window, axis, index):  # type: ignore[no-untyped-def]
    """Place of a node along an axis of a window."""
    period = window.period[axis]
    if period > 0 and not 0 <= index < period:  # a division would cost more than the rest
        index %= period
    return index - window.first[axis]


@njit(inline="always")
def fill(window, base, first, middle, last, nodes, S):  # type: ignore[no-untyped-def]
    """Fill the nodes and weights of a particle from its weights along the axes."""
    d = len(window.shape)
    n = 0
    for a in range(len(first)):
        plane = place_of(window, 0, base[0] + a)
        for b in range(len(middle) if d == 3 else 1):
            row = plane * window.shape[1] + place_of(window, 1, base[1] + b) if d == 3 else plane
            for c in range(len(last)):
                nodes[n] = row * window.shape[d - 1] + place_of(window, d - 1, base[2] + c)
                S[n] = first[a] * middle[b] * last[c]
                n += 1


@njit(inline="always")
def gimp_stencil(t, half, window, nodes, S):  # type: ignore[no-untyped-def]
    """Fill the ``3^d`` nodes and weights of a particle.

    Parameters
    ----------
    t, half : ndarray, shape ``(d,)``
        Position and half-widths in cells.
    window : Window
    nodes, S : ndarray, shape ``(3^d,)``
    """
    base, first, middle, last = gimp_weights(t, half, len(window.shape))
    fill(window, base, first, middle, last, nodes, S)


@njit(inline="always")
def gimp_gradients(t, half, window, cell, dS):  # type: ignore[no-untyped-def]
    """Fill the gradients ``(3^d, d)`` of a particle's weights, per length for cells of this edge.

    The nodes are in the same order as those of ``gimp_stencil``.
    """
    d = len(window.shape)
    _, a0, a1, a2, ga0, ga1, ga2 = stencil(t[0], half[0])
    _, c0, c1, c2, gc0, gc1, gc2 = stencil(t[d - 1], half[d - 1])
    b0, b1, b2, gb0, gb1, gb2 = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if d == 3:
        _, b0, b1, b2, gb0, gb1, gb2 = stencil(t[1], half[1])
    first, middle, last = (a0, a1, a2), (b0, b1, b2), (c0, c1, c2)
    by_first = (ga0 / cell, ga1 / cell, ga2 / cell)
    by_middle = (gb0 / cell, gb1 / cell, gb2 / cell)
    by_last = (gc0 / cell, gc1 / cell, gc2 / cell)
    n = 0
    for a in range(3):
        for b in range(3 if d == 3 else 1):
            for c in range(3):
                dS[n, 0] = by_first[a] * middle[b] * last[c]
                dS[n, 1] = first[a] * by_middle[b] * last[c]
                dS[n, d - 1] = first[a] * middle[b] * by_last[c]
                n += 1


@njit(inline="always")
def gimp_offsets(t, half, window, away):  # type: ignore[no-untyped-def]
    """Fill the positions ``(3^d, d)`` of a particle relative to its nodes, in cells."""
    d = len(window.shape)
    (i, j, k), _, _, _ = gimp_weights(t, half, d)
    n = 0
    for a in range(3):
        for b in range(3 if d == 3 else 1):
            for c in range(3):
                away[n, 0] = t[0] - (i + a)
                away[n, 1] = t[1] - (j + b)
                away[n, d - 1] = t[d - 1] - (k + c)
                n += 1


@njit(inline="always")
def linear_stencil(t, window, nodes, S):  # type: ignore[no-untyped-def]
    """Fill the ``2^d`` nodes and weights of the linear hat functions at ``t``; see above."""
    base, first, middle, last = linear_weights(t, len(window.shape))
    fill(window, base, first, middle, last, nodes, S)


@njit(inline="always")
def scatter(nodes, S, q, Q, count, columns):  # type: ignore[no-untyped-def]
    """P2G of one particle: add ``S_i q`` to the rows of ``Q``.

    Columns are taken in pairs, so that each node is looked up half as often.

    Parameters
    ----------
    nodes, S : ndarray, shape ``(count,)``
    q : ndarray, shape ``(columns,)``
    Q : ndarray, shape ``(nodes, columns)``
    count, columns : int
    """
    for k in range(columns // 2):
        one, two = q[2 * k], q[2 * k + 1]
        for i in range(count):
            Q[nodes[i], 2 * k] += S[i] * one
            Q[nodes[i], 2 * k + 1] += S[i] * two
    if columns % 2:
        one = q[columns - 1]
        for i in range(count):
            Q[nodes[i], columns - 1] += S[i] * one


@njit(inline="always")
def gather(nodes, S, Q, q, count, columns):  # type: ignore[no-untyped-def]
    """G2P of one particle: set ``q`` to ``sum_i S_i Q_i``; see ``scatter``."""
    for k in range(columns // 2):
        one, two = 0.0, 0.0
        for i in range(count):
            one += S[i] * Q[nodes[i], 2 * k]
            two += S[i] * Q[nodes[i], 2 * k + 1]
        q[2 * k], q[2 * k + 1] = one, two
    if columns % 2:
        one = 0.0
        for i in range(count):
            one += S[i] * Q[nodes[i], columns - 1]
        q[columns - 1] = one


@njit(inline="always")
def gather_gradient(nodes, dS, Q, slope, count, columns):  # type: ignore[no-untyped-def]
    """G2P of gradients of one particle: set ``slope[k]`` to ``sum_i Q_ik grad S_i``."""
    for k in range(columns):
        for axis in range(dS.shape[1]):
            total = 0.0
            for i in range(count):
                total += Q[nodes[i], k] * dS[i, axis]
            slope[k, axis] = total


# --- many particles ---------------------------------------------------------------------------


@njit(cache=True)
def gimp_stencils(
    t: Floats, half: Floats, cell: float, window: Window
) -> tuple[Ints, Floats, Floats]:
    """Nodes ``(n, 3^d)``, weights, and their gradients ``(n, 3^d, d)`` per length.

    Parameters
    ----------
    t, half : ndarray, shape ``(n, d)``
        Positions and half-widths in cells.
    cell : float
        Edge of a cell (length).
    window : Window
    """
    n, d = t.shape
    nodes, S, dS = np.empty((n, 3**d), np.int64), np.empty((n, 3**d)), np.empty((n, 3**d, d))
    for p in range(n):
        gimp_stencil(t[p], half[p], window, nodes[p], S[p])
        gimp_gradients(t[p], half[p], window, cell, dS[p])
    return nodes, S, dS


@njit(cache=True)
def linear_stencils(t: Floats, window: Window) -> tuple[Ints, Floats]:
    """Nodes and weights ``(n, 2^d)`` of the linear hat functions at ``t``, shape ``(n, d)``."""
    n, d = t.shape
    nodes, S = np.empty((n, 2**d), np.int64), np.empty((n, 2**d))
    for p in range(n):
        linear_stencil(t[p], window, nodes[p], S[p])
    return nodes, S


def particles_to_grid(nodes: Ints, S: Floats, q: Floats, Q: Floats) -> None:
    """P2G with stencils ``(n, m)``: add the particles' values ``(n, k)`` to ``Q``."""
    _particles_to_grid(nodes, S, q, Q, (0,) * nodes.shape[1], (0,) * q.shape[1])


def grid_to_particles(nodes: Ints, S: Floats, Q: Floats, q: Floats) -> None:
    """G2P with stencils ``(n, m)``: set the particles' values ``q``, shape ``(n, k)``."""
    _grid_to_particles(nodes, S, Q, q, (0,) * nodes.shape[1], (0,) * q.shape[1])


@njit(cache=True)
def _particles_to_grid(nodes, S, q, Q, count, columns):  # type: ignore[no-untyped-def]
    for p in range(nodes.shape[0]):
        scatter(nodes[p], S[p], q[p], Q, len(count), len(columns))


@njit(cache=True)
def _grid_to_particles(nodes, S, Q, q, count, columns):  # type: ignore[no-untyped-def]
    for p in range(nodes.shape[0]):
        gather(nodes[p], S[p], Q, q[p], len(count), len(columns))

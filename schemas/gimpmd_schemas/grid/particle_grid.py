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
from numba import njit

from gimpmd_schemas.arrays import Floats, Ints
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


@njit(inline="always")
def place_of(window, axis, index):  # type: ignore[no-untyped-def]
    """Place of a node along an axis of a window."""
    if window.period[axis] > 0:
        index %= window.period[axis]
    return index - window.first[axis]


@njit(inline="always")
def extend(window, axis, base, s, count, nodes, S):  # type: ignore[no-untyped-def]
    """Multiply the ``count`` entries of a stencil by the weights ``s`` along one more axis."""
    for k in range(count - 1, -1, -1):  # backwards, so that no entry is overwritten too early
        node, weight = nodes[k] * window.shape[axis], S[k]
        for j in range(len(s) - 1, -1, -1):
            nodes[len(s) * k + j] = node + place_of(window, axis, base + j)
            S[len(s) * k + j] = weight * s[j]
    return len(s) * count


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
    nodes[0], S[0], count = 0, 1.0, 1
    for axis in range(len(window.shape)):
        base, s0, s1, s2, _, _, _ = stencil(t[axis], half[axis])
        count = extend(window, axis, base, (s0, s1, s2), count, nodes, S)


@njit(inline="always")
def gimp_gradients(t, half, cell, dS):  # type: ignore[no-untyped-def]
    """Fill the gradients ``(3^d, d)`` of a particle's weights, per length for cells of this edge.

    The nodes are in the same order as those of ``gimp_stencil``.
    """
    dS[0], count = 1.0, 1
    for axis in range(dS.shape[1]):
        _, s0, s1, s2, g0, g1, g2 = stencil(t[axis], half[axis])
        s, g = (s0, s1, s2), (g0 / cell, g1 / cell, g2 / cell)
        for k in range(count - 1, -1, -1):
            for j in range(2, -1, -1):
                for component in range(dS.shape[1]):
                    factor = g[j] if component == axis else s[j]
                    dS[3 * k + j, component] = dS[k, component] * factor
        count *= 3


@njit(inline="always")
def linear_stencil(t, window, nodes, S):  # type: ignore[no-untyped-def]
    """Fill the ``2^d`` nodes and weights of the linear hat functions at ``t``; see above."""
    nodes[0], S[0], count = 0, 1.0, 1
    for axis in range(len(window.shape)):
        base, s0, s1 = hat(t[axis])
        count = extend(window, axis, base, (s0, s1), count, nodes, S)


@njit(inline="always")
def scatter(nodes, S, q, Q):  # type: ignore[no-untyped-def]
    """P2G of one particle: add ``S_i q`` to the rows of ``Q``, shape ``(nodes, k)``."""
    for i in range(nodes.size):
        for k in range(q.size):
            Q[nodes[i], k] += S[i] * q[k]


@njit(inline="always")
def gather(nodes, S, Q, q):  # type: ignore[no-untyped-def]
    """G2P of one particle: set ``q``, shape ``(k,)``, to ``sum_i S_i Q_i``."""
    for k in range(q.size):
        total = 0.0
        for i in range(nodes.size):
            total += S[i] * Q[nodes[i], k]
        q[k] = total


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
        gimp_gradients(t[p], half[p], cell, dS[p])
    return nodes, S, dS


@njit(cache=True)
def linear_stencils(t: Floats, window: Window) -> tuple[Ints, Floats]:
    """Nodes and weights ``(n, 2^d)`` of the linear hat functions at ``t``, shape ``(n, d)``."""
    n, d = t.shape
    nodes, S = np.empty((n, 2**d), np.int64), np.empty((n, 2**d))
    for p in range(n):
        linear_stencil(t[p], window, nodes[p], S[p])
    return nodes, S


@njit(cache=True)
def particles_to_grid(nodes: Ints, S: Floats, q: Floats, Q: Floats) -> None:
    """P2G with stencils ``(n, m)``: add the particles' values ``(n, k)`` to ``Q``."""
    for p in range(nodes.shape[0]):
        scatter(nodes[p], S[p], q[p], Q)


@njit(cache=True)
def grid_to_particles(nodes: Ints, S: Floats, Q: Floats, q: Floats) -> None:
    """G2P with stencils ``(n, m)``: set the particles' values ``q``, shape ``(n, k)``."""
    for p in range(nodes.shape[0]):
        gather(nodes[p], S[p], Q, q[p])

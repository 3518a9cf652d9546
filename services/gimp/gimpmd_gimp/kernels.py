"""Sweeps over material points: stencils, points to nodes, nodes to points.

One source for one, two and three dimensions: the length of the tuple ``Stencils.axes`` is known
when a sweep is compiled, so loops over it unroll. Every sweep takes the points
``order[first:last]``, so that threads can share them (``threads.py``).

Nodal arrays are flat (``mesh.py``). A point touches three nodes along each axis. ``across[p]`` is
-1, or the row of ``detour`` that names the ``3^d`` nodes of a point whose stencil a crack cuts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from gimpmd_gimp.points import Flags
from gimpmd_schemas.grid import Floats, Ints
from gimpmd_schemas.interpolation import stencil

sweep = njit(nogil=True, cache=True, fastmath={"contract"})
"""Compile a sweep; it releases the interpreter, and sums keep their order."""

GIMP, BSPLINE = 0, 1
"""Kinds of interpolation: the hat averaged over the point's domain, the quadratic B-spline."""

HAT = 1e-9
"""Half-width of a point for which GIMP is the linear hat function, in cells."""


class Frames(NamedTuple):
    """Where the blocks of a mesh lie: row b speaks of block b.

    Attributes
    ----------
    centre : ndarray, shape ``(b, d)``
        Middle of the block (length).
    middle : ndarray, shape ``(b, d)``
        The same, counted in cells from the block's first node.
    per_cell : ndarray, shape ``(b,)``
        One over the cell's edge.
    shape, strides : ndarray of int64, shape ``(b, d)``
        Nodes along each axis, and steps between them in flat arrays.
    offset : ndarray of int64, shape ``(b,)``
        Flat number of the first node.
    period : ndarray, shape ``(d,)``
        Length after which the domain repeats, 0 where it does not.
    """

    centre: Floats
    middle: Floats
    per_cell: Floats
    shape: Ints
    strides: Ints
    offset: Ints
    period: Floats


class Stencils(NamedTuple):
    """Nodes and weights of every point.

    Attributes
    ----------
    axes : tuple of int
        One entry for each dimension.
    base : ndarray of int64, shape ``(n,)``
        Flat number of the first node.
    w, g : ndarray, shape ``(n, 3 d)``
        Weights of the three nodes along each axis, and their gradients (per length).
    block : ndarray of int32, shape ``(n,)``
    strides : ndarray of int64, shape ``(b, d)``
    across : ndarray of int64, shape ``(n,)``
    detour : ndarray of int64, shape ``(m, 3^d)``
    """

    axes: tuple[int, ...]
    base: Ints
    w: Floats
    g: Floats
    block: Flags
    strides: Ints
    across: Ints
    detour: Ints


@njit(inline="always")
def bspline(x: float) -> tuple[int, float, float, float, float, float, float]:
    """Quadratic B-spline: first of three nodes, weights and gradients (Steffen et al. 2008)."""
    centre = np.floor(x + 0.5)
    r = x - centre
    left, right = 0.5 - r, 0.5 + r
    return (
        int(centre) - 1,
        0.5 * left * left,
        0.75 - r * r,
        0.5 * right * right,
        -left,
        -2.0 * r,
        right,
    )


@sweep
def fill_stencils(
    order: Ints,
    first: int,
    last: int,
    s: Stencils,
    frames: Frames,
    kind: int,
    stretch: bool,
    x: Floats,
    half: Floats,
    F: Floats,
    home: Floats,
) -> tuple[int, int]:
    """First node and weights of every point (paper Eq. 14) into ``s.base``, ``s.w``, ``s.g``.

    Parameters
    ----------
    kind : int
        ``GIMP`` or ``BSPLINE``.
    stretch : bool
        Whether a point's domain follows the diagonal of F (cpGIMP).
    home : ndarray, shape ``(n, d)``
        Where the points stood when they were sorted, in cells of their block.

    Returns
    -------
    lost, drifted : int
        Points outside their block, and points a quarter of a cell away from home.
    """
    lost, drifted = 0, 0
    for k in range(first, last):
        p = order[k]
        b = s.block[p]
        base, out, far = frames.offset[b], False, False
        for d in range(len(s.axes)):
            y = x[p, d] - frames.centre[b, d]
            if frames.period[d] > 0.0:
                y -= frames.period[d] * np.floor(y / frames.period[d] + 0.5)
            t = y * frames.per_cell[b] + frames.middle[b, d]
            if not (0.5 <= t < frames.shape[b, d] - 1.5):  # NaN is out too
                out = True
                break
            far |= abs(t - home[p, d]) > 0.25
            if kind == GIMP:
                l = half[p, d]  # noqa: E741
                if stretch:
                    l *= F[p, d, d]  # noqa: E741
                i, s0, s1, s2, g0, g1, g2 = stencil(t, min(l, 0.5))
            else:
                i, s0, s1, s2, g0, g1, g2 = bspline(t)
            s.w[p, 3 * d], s.w[p, 3 * d + 1], s.w[p, 3 * d + 2] = s0, s1, s2
            s.g[p, 3 * d] = g0 * frames.per_cell[b]
            s.g[p, 3 * d + 1] = g1 * frames.per_cell[b]
            s.g[p, 3 * d + 2] = g2 * frames.per_cell[b]
            base += i * frames.strides[b, d]
        if out:
            lost += 1
            continue
        drifted += far
        s.base[p] = base
    return lost, drifted


@njit(inline="always")
def _rows(s: Stencils) -> int:
    """Rows of three nodes, along the last axis, in a stencil."""
    if len(s.axes) == 1:
        return 1
    if len(s.axes) == 2:
        return 3
    return 9


@njit(inline="always")
def _row(s: Stencils, p: int, r: int) -> tuple[int, float]:
    """First node of row r of a stencil, and the product of the weights along the other axes."""
    if len(s.axes) == 1:
        return s.base[p], 1.0
    b = s.block[p]
    if len(s.axes) == 2:
        return s.base[p] + r * s.strides[b, 0], s.w[p, r]
    i, j = r // 3, r % 3
    node = s.base[p] + i * s.strides[b, 0] + j * s.strides[b, 1]
    return node, s.w[p, i] * s.w[p, 3 + j]


@njit(inline="always")
def _slope(s: Stencils, p: int, r: int, d: int) -> float:
    """Gradient along axis d, not the last one, of the product that ``_row`` gives."""
    if len(s.axes) == 2:
        return s.g[p, r]
    i, j = r // 3, r % 3
    if d == 0:
        return s.g[p, i] * s.w[p, 3 + j]
    return s.w[p, i] * s.g[p, 3 + j]


@njit(inline="always")
def _node(s: Stencils, p: int, first: int, r: int, a: int) -> int:
    if s.across[p] >= 0:
        return s.detour[s.across[p], 3 * r + a]
    return first + a


@sweep
def scatter_mass(order: Ints, first: int, last: int, s: Stencils, mass: Floats, M: Floats) -> None:
    """Nodal mass, ``M_i += S_ip m_p`` (paper section 3.1)."""
    last_axis = 3 * (len(s.axes) - 1)
    for k in range(first, last):
        p = order[k]
        for r in range(_rows(s)):
            start, weight = _row(s, p, r)
            for a in range(3):
                i = _node(s, p, start, r, a)
                M[i] += weight * s.w[p, last_axis + a] * mass[p]


@sweep
def scatter_momentum(
    order: Ints,
    first: int,
    last: int,
    s: Stencils,
    mass: Floats,
    v: Floats,
    M: Floats,
    P: Floats,
) -> None:
    """Add mass and momentum of the points to the nodes (paper Eq. 16)."""
    last_axis = 3 * (len(s.axes) - 1)
    for k in range(first, last):
        p = order[k]
        for r in range(_rows(s)):
            start, weight = _row(s, p, r)
            for a in range(3):
                i = _node(s, p, start, r, a)
                m = weight * s.w[p, last_axis + a] * mass[p]
                M[i] += m
                for d in range(len(s.axes)):
                    P[i, d] += m * v[p, d]


@sweep
def scatter_vector(
    order: Ints, first: int, last: int, s: Stencils, mass: Floats, q: Floats, Q: Floats
) -> None:
    """Momentum of a point field, ``Q_i += S_ip m_p q_p``."""
    last_axis = 3 * (len(s.axes) - 1)
    for k in range(first, last):
        p = order[k]
        for r in range(_rows(s)):
            start, weight = _row(s, p, r)
            for a in range(3):
                i = _node(s, p, start, r, a)
                m = weight * s.w[p, last_axis + a] * mass[p]
                for d in range(len(s.axes)):
                    Q[i, d] += m * q[p, d]


@sweep
def scatter_force(
    order: Ints,
    first: int,
    last: int,
    s: Stencils,
    factor: float,
    volume: Floats,
    stress: Floats,
    J: Floats,
) -> None:
    """Internal force, ``J_i -= factor V_p tau_p . grad S_ip`` (paper section 2, under Eq. 2).

    Parameters
    ----------
    factor : float
        One for a force, a time step for an impulse.
    volume : ndarray, shape ``(n,)``
        Reference volume, since the stress is Kirchhoff's: ``V sigma = V_0 tau``.
    stress : ndarray, shape ``(n, d, d)``
    """
    last_axis = 3 * (len(s.axes) - 1)
    for k in range(first, last):
        p = order[k]
        V = factor * volume[p]
        for r in range(_rows(s)):
            start, weight = _row(s, p, r)
            for a in range(3):
                i = _node(s, p, start, r, a)
                across = weight * s.g[p, last_axis + a]
                for d in range(len(s.axes)):
                    f = stress[p, d, len(s.axes) - 1] * across
                    for e in range(len(s.axes) - 1):
                        f += stress[p, d, e] * _slope(s, p, r, e) * s.w[p, last_axis + a]
                    J[i, d] -= V * f


@sweep
def gather_vector(
    order: Ints, first: int, last: int, s: Stencils, Q: Floats, factor: float, q: Floats
) -> None:
    """Add a nodal field to the points: ``q_p += factor sum_i S_ip Q_i`` (paper Eq. 5)."""
    last_axis = 3 * (len(s.axes) - 1)
    for k in range(first, last):
        p = order[k]
        for d in range(len(s.axes)):
            total = 0.0
            for r in range(_rows(s)):
                start, weight = _row(s, p, r)
                for a in range(3):
                    i = _node(s, p, start, r, a)
                    total += weight * s.w[p, last_axis + a] * Q[i, d]
            q[p, d] += factor * total


@sweep
def kick(
    order: Ints,
    first: int,
    last: int,
    s: Stencils,
    U: Floats,
    mass: Floats,
    v: Floats,
    dv: Floats,
    P: Floats,
) -> None:
    """Kick the points and add their new momentum to the nodes, in one sweep.

    ``dv_p = sum_i S_ip U_i``, ``v_p += dv_p`` (FLIP), ``P_i += S_ip m_p v_p``.

    Parameters
    ----------
    U : ndarray, shape ``(size, d)``
        Change of the nodal velocity: impulse over nodal mass.
    """
    last_axis = 3 * (len(s.axes) - 1)
    for k in range(first, last):
        p = order[k]
        for d in range(len(s.axes)):
            total = 0.0
            for r in range(_rows(s)):
                start, weight = _row(s, p, r)
                for a in range(3):
                    i = _node(s, p, start, r, a)
                    total += weight * s.w[p, last_axis + a] * U[i, d]
            dv[p, d] = total
            v[p, d] += total
        for r in range(_rows(s)):
            start, weight = _row(s, p, r)
            for a in range(3):
                i = _node(s, p, start, r, a)
                m = weight * s.w[p, last_axis + a] * mass[p]
                for d in range(len(s.axes)):
                    P[i, d] += m * v[p, d]


@sweep
def gather_motion(
    order: Ints,
    first: int,
    last: int,
    s: Stencils,
    V: Floats,
    dt: float,
    finite: bool,
    F: Floats,
    x_step: float,
    x: Floats,
) -> None:
    """Deform, and if asked move, the points with a nodal velocity (paper Eqs. 5, 7, 8).

    ``F += dt L`` for laws of small strain, ``F <- (I + dt L) F`` for finite ones, with
    ``L = sum_i V_i grad S_ip``; ``x += x_step sum_i S_ip V_i``.
    """
    dim = len(s.axes)
    last_axis = 3 * (dim - 1)
    L = np.empty((dim, dim))
    D = np.empty((dim, dim))
    for k in range(first, last):
        p = order[k]
        for d in range(dim):
            moved = 0.0
            for r in range(_rows(s)):
                start, weight = _row(s, p, r)
                for a in range(3):
                    i = _node(s, p, start, r, a)
                    moved += weight * s.w[p, last_axis + a] * V[i, d]
            x[p, d] += x_step * moved
            for e in range(dim):
                rate = 0.0
                for r in range(_rows(s)):
                    start, weight = _row(s, p, r)
                    slope = weight if e == dim - 1 else _slope(s, p, r, e)
                    for a in range(3):
                        i = _node(s, p, start, r, a)
                        if e == dim - 1:
                            rate += slope * s.g[p, last_axis + a] * V[i, d]
                        else:
                            rate += slope * s.w[p, last_axis + a] * V[i, d]
                L[d, e] = dt * rate
        if finite:
            for d in range(dim):
                for e in range(dim):
                    D[d, e] = F[p, d, e]
                    for c in range(dim):
                        D[d, e] += L[d, c] * F[p, c, e]
            for d in range(dim):
                for e in range(dim):
                    F[p, d, e] = D[d, e]
        else:
            for d in range(dim):
                for e in range(dim):
                    F[p, d, e] += L[d, e]


@sweep
def sum_energies(
    order: Ints,
    first: int,
    last: int,
    mass: Floats,
    v: Floats,
    volume: Floats,
    density: Floats,
    sums: Floats,
) -> None:
    """Add kinetic and strain energy, mass and momentum of the points to ``sums``, ``(3 + d,)``.

    ``density`` is the strain energy per reference volume.
    """
    kinetic, potential, total = 0.0, 0.0, 0.0
    for k in range(first, last):
        p = order[k]
        square = 0.0
        for d in range(v.shape[1]):
            square += v[p, d] * v[p, d]
            sums[3 + d] += mass[p] * v[p, d]
        kinetic += 0.5 * mass[p] * square
        potential += volume[p] * density[p]
        total += mass[p]
    sums[0] += kinetic
    sums[1] += potential
    sums[2] += total


@sweep
def clear(nodes: Ints, field: Floats) -> None:
    """Zero a nodal field ``(size, k)`` at some nodes."""
    for n in range(nodes.size):
        for k in range(field.shape[1]):
            field[nodes[n], k] = 0.0


@sweep
def divide(nodes: Ints, P: Floats, M: Floats, floor: float, V: Floats) -> None:
    """Nodal velocity ``V_i = P_i / M_i``, zero where the nodal mass does not exceed ``floor``."""
    for n in range(nodes.size):
        i = nodes[n]
        inverse = 1.0 / M[i] if M[i] > floor else 0.0
        for d in range(P.shape[1]):
            V[i, d] = P[i, d] * inverse


@sweep
def add(nodes: Ints, Q: Floats, factor: float, into: Floats) -> None:
    """``into_i += factor Q_i`` at some nodes."""
    for n in range(nodes.size):
        i = nodes[n]
        for d in range(Q.shape[1]):
            into[i, d] += factor * Q[i, d]


@sweep
def inertia(nodes: Ints, M: Floats, U: Floats, J: Floats) -> None:
    """``J_i -= M_i U_i``: what an impulse has left once a mass has taken its share."""
    for n in range(nodes.size):
        i = nodes[n]
        for d in range(J.shape[1]):
            J[i, d] -= M[i] * U[i, d]


@sweep
def work(nodes: Ints, J: Floats, V: Floats, counts: Floats) -> float:
    """``sum_i counts_i J_i . V_i`` over some nodes."""
    total = 0.0
    for n in range(nodes.size):
        i = nodes[n]
        for d in range(J.shape[1]):
            total += counts[i] * J[i, d] * V[i, d]
    return total

"""Sweeps over the material points: stencils, points to nodes, nodes to points.

Nodal arrays are flat: first the nodes of the padded grid in the order of their ids, then the
twins that carry the second velocity field across cracks. ``across[p]`` is -1, or the row of
``detour`` that names the nine nodes of a point whose stencil a crack cuts.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from gimpmd_schemas.grid import PAD, Floats, Ints
from gimpmd_schemas.interpolation import stencil

WEIGHTS = 12
"""Per point: weights s0 s1 s2 along x, along y; then gradients along x, along y (per length)."""


@njit(parallel=True, cache=True)
def fill_stencils(
    order: Ints,
    start: Ints,
    x: Floats,
    half: Floats,
    origin: Floats,
    period: Floats,
    h: float,
    shape: tuple[int, int],
    row: Ints,
    base: Ints,
    w: Floats,
) -> tuple[int, int]:
    """First node and weights of every point (paper Eq. 14) into ``base (n,)``, ``w (n, 12)``.

    Parameters
    ----------
    origin : ndarray, shape ``(2,)``
        Lower corner of the domain, which is node ``(PAD, PAD)`` of the padded array.
    period : ndarray, shape ``(2,)``
        Length after which the domain repeats, 0 where it does not.
    row : ndarray of int64, shape ``(n,)``
        Node row by which each point was sorted into its block.

    Returns
    -------
    lost, drifted : int
        Points outside the grid, and points more than one row away from ``row``.
    """
    lost, drifted = 0, 0
    per_h = 1.0 / h
    for block in prange(start.size - 1):
        for k in range(start[block], start[block + 1]):
            p = order[k]
            sx, sy = x[p, 0] - origin[0], x[p, 1] - origin[1]
            if period[0] > 0.0:
                sx -= period[0] * np.floor(sx / period[0])
            if period[1] > 0.0:
                sy -= period[1] * np.floor(sy / period[1])
            i, w[p, 0], w[p, 1], w[p, 2], g0, g1, g2 = stencil(sx * per_h + PAD, half[p, 0])
            w[p, 6], w[p, 7], w[p, 8] = g0 * per_h, g1 * per_h, g2 * per_h
            j, w[p, 3], w[p, 4], w[p, 5], g0, g1, g2 = stencil(sy * per_h + PAD, half[p, 1])
            w[p, 9], w[p, 10], w[p, 11] = g0 * per_h, g1 * per_h, g2 * per_h
            base[p] = i * shape[1] + j
            if i < 0 or j < 0 or i + 2 >= shape[0] or j + 2 >= shape[1]:
                lost += 1
            if abs(i - row[p]) > 1:
                drifted += 1
    return lost, drifted


@njit(inline="always")
def _node(base: int, a: int, b: int, columns: int, across: int, detour: Ints) -> int:
    if across >= 0:
        return detour[across, 3 * a + b]
    return base + a * columns + b


@njit(parallel=True, cache=True, fastmath={"contract"})
def scatter_state(
    order: Ints,
    start: Ints,
    base: Ints,
    w: Floats,
    columns: int,
    across: Ints,
    detour: Ints,
    mass: Floats,
    v: Floats,
    volume: Floats,
    stress: Floats,
    M: Floats,
    P: Floats,
    F: Floats,
) -> None:
    """Add mass, momentum and internal force of the points to the nodes (paper Eqs. 1, 2, 16).

    ``M_i += S_ip m_p``, ``P_i += S_ip m_p v_p``, ``F_i -= V_p sigma_p . grad S_ip``.
    """
    for colour in range(2):
        for pair in prange((start.size - colour) // 2):
            block = 2 * pair + colour
            for k in range(start[block], start[block + 1]):
                p = order[k]
                m, px, py = mass[p], mass[p] * v[p, 0], mass[p] * v[p, 1]
                sxx, syy = volume[p] * stress[p, 0], volume[p] * stress[p, 1]
                sxy = volume[p] * stress[p, 2]
                for a in range(3):
                    for b in range(3):
                        i = _node(base[p], a, b, columns, across[p], detour)
                        s = w[p, a] * w[p, 3 + b]
                        gx, gy = w[p, 6 + a] * w[p, 3 + b], w[p, a] * w[p, 9 + b]
                        M[i] += s * m
                        P[i, 0] += s * px
                        P[i, 1] += s * py
                        F[i, 0] -= sxx * gx + sxy * gy
                        F[i, 1] -= sxy * gx + syy * gy


@njit(parallel=True, cache=True, fastmath={"contract"})
def scatter_vector(
    order: Ints,
    start: Ints,
    base: Ints,
    w: Floats,
    columns: int,
    across: Ints,
    detour: Ints,
    mass: Floats,
    q: Floats,
    Q: Floats,
) -> None:
    """Add ``S_ip m_p q_p`` to the nodes: the momentum of a point field q (n, 2)."""
    for colour in range(2):
        for pair in prange((start.size - colour) // 2):
            block = 2 * pair + colour
            for k in range(start[block], start[block + 1]):
                p = order[k]
                qx, qy = mass[p] * q[p, 0], mass[p] * q[p, 1]
                for a in range(3):
                    for b in range(3):
                        i = _node(base[p], a, b, columns, across[p], detour)
                        s = w[p, a] * w[p, 3 + b]
                        Q[i, 0] += s * qx
                        Q[i, 1] += s * qy


@njit(parallel=True, cache=True, fastmath={"contract"})
def gather_vector(
    order: Ints,
    start: Ints,
    base: Ints,
    w: Floats,
    columns: int,
    across: Ints,
    detour: Ints,
    Q: Floats,
    q: Floats,
) -> None:
    """Interpolate a nodal field to the points: ``q_p = sum_i S_ip Q_i`` (paper Eq. 5)."""
    for block in prange(start.size - 1):
        for k in range(start[block], start[block + 1]):
            p = order[k]
            qx, qy = 0.0, 0.0
            for a in range(3):
                for b in range(3):
                    i = _node(base[p], a, b, columns, across[p], detour)
                    s = w[p, a] * w[p, 3 + b]
                    qx += s * Q[i, 0]
                    qy += s * Q[i, 1]
            q[p, 0] = qx
            q[p, 1] = qy


@njit(parallel=True, cache=True, fastmath={"contract"})
def gather_motion(
    order: Ints,
    start: Ints,
    base: Ints,
    w: Floats,
    columns: int,
    across: Ints,
    detour: Ints,
    V: Floats,
    dt: float,
    stretch: bool,
    x_step: float,
    strain: Floats,
    half: Floats,
    volume: Floats,
    x: Floats,
) -> None:
    """Strain, and if asked move, the points with a nodal velocity (paper Eqs. 5, 7, 8).

    ``strain += dt sym(grad V)``; ``x += x_step sum_i S_ip V_i``. With ``stretch`` the points'
    domains follow the normal strain rates (cpGIMP).
    """
    for block in prange(start.size - 1):
        for k in range(start[block], start[block + 1]):
            p = order[k]
            vx, vy, xx, xy, yx, yy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for a in range(3):
                for b in range(3):
                    i = _node(base[p], a, b, columns, across[p], detour)
                    s = w[p, a] * w[p, 3 + b]
                    gx, gy = w[p, 6 + a] * w[p, 3 + b], w[p, a] * w[p, 9 + b]
                    vx += s * V[i, 0]
                    vy += s * V[i, 1]
                    xx += gx * V[i, 0]
                    xy += gy * V[i, 0]
                    yx += gx * V[i, 1]
                    yy += gy * V[i, 1]
            strain[p, 0] += dt * xx
            strain[p, 1] += dt * yy
            strain[p, 2] += dt * (xy + yx)
            if stretch:
                half[p, 0] *= 1.0 + dt * xx
                half[p, 1] *= 1.0 + dt * yy
                volume[p] *= 1.0 + dt * (xx + yy)
            x[p, 0] += x_step * vx
            x[p, 1] += x_step * vy


@njit(parallel=True, cache=True, fastmath={"contract"})
def sum_energies(
    order: Ints,
    start: Ints,
    mass: Floats,
    v: Floats,
    a: Floats,
    lag: float,
    volume: Floats,
    stress: Floats,
    strain: Floats,
) -> Floats:
    """Kinetic and strain energy, mass and momentum (5,) of a group.

    Velocities are taken ``lag`` later than they stand, ``v + lag a``. Blocks are summed in
    order, so the sums do not depend on the number of threads.
    """
    blocks = start.size - 1
    parts = np.zeros((blocks, 5))
    for block in prange(blocks):
        for k in range(start[block], start[block + 1]):
            p = order[k]
            vx, vy = v[p, 0] + lag * a[p, 0], v[p, 1] + lag * a[p, 1]
            work = stress[p, 0] * strain[p, 0] + stress[p, 1] * strain[p, 1]
            work += stress[p, 2] * strain[p, 2]
            parts[block, 0] += 0.5 * mass[p] * (vx * vx + vy * vy)
            parts[block, 1] += 0.5 * volume[p] * work
            parts[block, 2] += mass[p]
            parts[block, 3] += mass[p] * vx
            parts[block, 4] += mass[p] * vy
    return parts.sum(axis=0)


@njit(cache=True)
def scatter_points(
    position: Floats,
    half: Floats,
    load: Floats,
    origin: Floats,
    h: float,
    columns: int,
    F: Floats,
) -> None:
    """Add loads (n, 2) at given positions to the nodes, ``F_i += S_i(x) load``."""
    for p in range(position.shape[0]):
        i, a0, a1, a2, _, _, _ = stencil((position[p, 0] - origin[0]) / h + PAD, half[p, 0])
        j, b0, b1, b2, _, _, _ = stencil((position[p, 1] - origin[1]) / h + PAD, half[p, 1])
        for a, wa in enumerate((a0, a1, a2)):
            for b, wb in enumerate((b0, b1, b2)):
                node = (i + a) * columns + j + b
                F[node, 0] += wa * wb * load[p, 0]
                F[node, 1] += wa * wb * load[p, 1]


@njit(cache=True)
def divide(P: Floats, M: Floats, floor: float) -> Floats:
    """Nodal velocity ``P_i / M_i``, zero where the nodal mass does not exceed ``floor``."""
    V = np.zeros_like(P)
    for i in range(M.size):
        if M[i] > floor:
            V[i, 0] = P[i, 0] / M[i]
            V[i, 1] = P[i, 1] / M[i]
    return V

"""Sweeps over material points: stencils, points to nodes, nodes to points.

Every sweep takes the points ``order[first:last]``, so that threads can share them
(``threads.py``). Nodal arrays are flat: first the nodes of the padded grid in the order of their
ids, then the twins that carry the second velocity field across cracks. ``across[p]`` is -1, or the
row of ``detour`` that names the nine nodes of a point whose stencil a crack cuts.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from gimpmd_schemas.grid import PAD, Floats, Ints
from gimpmd_schemas.interpolation import stencil

WEIGHTS = 12
"""Per point: weights s0 s1 s2 along x, along y; then gradients along x, along y (per length)."""

sweep = njit(nogil=True, cache=True, fastmath={"contract"})
"""Compile a sweep; it releases the interpreter, and sums keep their order."""


@sweep
def fill_stencils(
    order: Ints,
    first: int,
    last: int,
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
    for k in range(first, last):
        p = order[k]
        sx, sy = x[p, 0] - origin[0], x[p, 1] - origin[1]
        if period[0] > 0.0:
            sx -= period[0] * np.floor(sx / period[0])
        if period[1] > 0.0:
            sy -= period[1] * np.floor(sy / period[1])
        sx, sy = sx * per_h + PAD, sy * per_h + PAD
        if not (0.5 <= sx < shape[0] - 1.5 and 0.5 <= sy < shape[1] - 1.5):  # NaN is lost too
            lost += 1
            continue
        i, w[p, 0], w[p, 1], w[p, 2], g0, g1, g2 = stencil(sx, min(half[p, 0], 0.5))
        w[p, 6], w[p, 7], w[p, 8] = g0 * per_h, g1 * per_h, g2 * per_h
        j, w[p, 3], w[p, 4], w[p, 5], g0, g1, g2 = stencil(sy, min(half[p, 1], 0.5))
        w[p, 9], w[p, 10], w[p, 11] = g0 * per_h, g1 * per_h, g2 * per_h
        base[p] = i * shape[1] + j
        if abs(i - row[p]) > 1:
            drifted += 1
    return lost, drifted


@njit(inline="always")
def _node(base: int, a: int, b: int, columns: int, across: int, detour: Ints) -> int:
    if across >= 0:
        return detour[across, 3 * a + b]
    return base + a * columns + b


@sweep
def scatter_force(
    order: Ints,
    first: int,
    last: int,
    base: Ints,
    w: Floats,
    columns: int,
    across: Ints,
    detour: Ints,
    mass: Floats,
    volume: Floats,
    stress: Floats,
    M: Floats,
    F: Floats,
) -> None:
    """Add mass and internal force of the points to the nodes (paper section 3.1).

    ``M_i += S_ip m_p``, ``F_i -= V_p sigma_p . grad S_ip``.
    """
    for k in range(first, last):
        p = order[k]
        sxx, syy = volume[p] * stress[p, 0], volume[p] * stress[p, 1]
        sxy = volume[p] * stress[p, 2]
        for a in range(3):
            for b in range(3):
                i = _node(base[p], a, b, columns, across[p], detour)
                gx, gy = w[p, 6 + a] * w[p, 3 + b], w[p, a] * w[p, 9 + b]
                M[i] += w[p, a] * w[p, 3 + b] * mass[p]
                F[i, 0] -= sxx * gx + sxy * gy
                F[i, 1] -= sxy * gx + syy * gy


@sweep
def scatter_momentum(
    order: Ints,
    first: int,
    last: int,
    base: Ints,
    w: Floats,
    columns: int,
    across: Ints,
    detour: Ints,
    mass: Floats,
    v: Floats,
    M: Floats,
    P: Floats,
) -> None:
    """Add mass and momentum of the points to the nodes (paper Eq. 16)."""
    for k in range(first, last):
        p = order[k]
        px, py = mass[p] * v[p, 0], mass[p] * v[p, 1]
        for a in range(3):
            for b in range(3):
                i = _node(base[p], a, b, columns, across[p], detour)
                s = w[p, a] * w[p, 3 + b]
                M[i] += s * mass[p]
                P[i, 0] += s * px
                P[i, 1] += s * py


@sweep
def scatter_vector(
    order: Ints,
    first: int,
    last: int,
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
    for k in range(first, last):
        p = order[k]
        qx, qy = mass[p] * q[p, 0], mass[p] * q[p, 1]
        for a in range(3):
            for b in range(3):
                i = _node(base[p], a, b, columns, across[p], detour)
                s = w[p, a] * w[p, 3 + b]
                Q[i, 0] += s * qx
                Q[i, 1] += s * qy


@sweep
def gather_vector(
    order: Ints,
    first: int,
    last: int,
    base: Ints,
    w: Floats,
    columns: int,
    across: Ints,
    detour: Ints,
    Q: Floats,
    factor: float,
    q: Floats,
) -> None:
    """Add a nodal field to the points: ``q_p += factor sum_i S_ip Q_i`` (paper Eq. 5)."""
    for k in range(first, last):
        p = order[k]
        qx, qy = 0.0, 0.0
        for a in range(3):
            for b in range(3):
                i = _node(base[p], a, b, columns, across[p], detour)
                s = w[p, a] * w[p, 3 + b]
                qx += s * Q[i, 0]
                qy += s * Q[i, 1]
        q[p, 0] += factor * qx
        q[p, 1] += factor * qy


@sweep
def kick(
    order: Ints,
    first: int,
    last: int,
    base: Ints,
    w: Floats,
    columns: int,
    across: Ints,
    detour: Ints,
    A: Floats,
    dt: float,
    mass: Floats,
    v: Floats,
    a_p: Floats,
    P: Floats,
) -> None:
    """Accelerate the points and add their new momentum to the nodes, in one sweep.

    ``a_p = sum_i S_ip A_i``, ``v_p += dt a_p`` (FLIP), ``P_i += S_ip m_p v_p``.
    """
    for k in range(first, last):
        p = order[k]
        ax, ay = 0.0, 0.0
        for a in range(3):
            for b in range(3):
                i = _node(base[p], a, b, columns, across[p], detour)
                s = w[p, a] * w[p, 3 + b]
                ax += s * A[i, 0]
                ay += s * A[i, 1]
        a_p[p, 0], a_p[p, 1] = ax, ay
        v[p, 0] += dt * ax
        v[p, 1] += dt * ay
        px, py = mass[p] * v[p, 0], mass[p] * v[p, 1]
        for a in range(3):
            for b in range(3):
                i = _node(base[p], a, b, columns, across[p], detour)
                s = w[p, a] * w[p, 3 + b]
                P[i, 0] += s * px
                P[i, 1] += s * py


@sweep
def gather_motion(
    order: Ints,
    first: int,
    last: int,
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
    for k in range(first, last):
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


@sweep
def sum_energies(
    order: Ints,
    first: int,
    last: int,
    mass: Floats,
    v: Floats,
    a: Floats,
    lag: float,
    volume: Floats,
    stress: Floats,
    strain: Floats,
) -> tuple[float, float, float, float, float]:
    """Kinetic and strain energy, mass and both momenta of the points.

    Velocities are taken ``lag`` later than they stand, ``v + lag a``.
    """
    kinetic, potential, total, momentum_x, momentum_y = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(first, last):
        p = order[k]
        m, vx, vy = mass[p], v[p, 0] + lag * a[p, 0], v[p, 1] + lag * a[p, 1]
        work = stress[p, 0] * strain[p, 0] + stress[p, 1] * strain[p, 1]
        work += stress[p, 2] * strain[p, 2]
        kinetic += 0.5 * m * (vx * vx + vy * vy)
        potential += 0.5 * volume[p] * work
        total += m
        momentum_x += m * vx
        momentum_y += m * vy
    return kinetic, potential, total, momentum_x, momentum_y


@sweep
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


@sweep
def divide(P: Floats, M: Floats, floor: float) -> Floats:
    """Nodal velocity ``P_i / M_i``, zero where the nodal mass does not exceed ``floor``."""
    V = np.zeros_like(P)
    for i in range(M.size):
        if M[i] > floor:
            inverse = 1.0 / M[i]
            V[i, 0] = P[i, 0] * inverse
            V[i, 1] = P[i, 1] * inverse
    return V


@sweep
def power(F: Floats, V: Floats, counts: Floats) -> float:
    """``sum_i counts_i F_i . V_i``; periodic images have a count of zero."""
    total = 0.0
    for i in range(counts.size):
        total += counts[i] * (F[i, 0] * V[i, 0] + F[i, 1] * V[i, 1])
    return total

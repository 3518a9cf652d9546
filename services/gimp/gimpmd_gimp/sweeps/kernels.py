"""Sweeps over material points: stencils, points to nodes, nodes to points.

One source serves one, two and three dimensions: the length of the tuple ``Stencils.axes`` is known
when a sweep is compiled, so the compiler unrolls loops over it. Every sweep handles the points
``order[first:last]``, so that threads can share them (``threads.py``). An empty ``order`` means all
points in turn. Memory limits the speed of several threads, so sweeps read as few bytes of a point
as possible.

Weights are products of one-dimensional ones, and the three nodes of a row, along the last axis, are
neighbours in memory. Therefore sweeps read and write whole rows. A gather sums the rows with the
weights across them, and then contracts the resulting row with the weights along it. A scatter forms
this row once and adds multiples of it.

Nodal arrays are flat (``mesh.py``). A point touches three nodes along each axis, the first of which
is ``base[p]``. If a crack cuts the stencil of a point, its ``3^d`` nodes are listed in row
``-1 - base[p]`` of ``detour``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gimpmd_gimp.sweeps.simd import (
    Vector,
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
from gimpmd_schemas.arrays import Float32s, Floats, Int32s, Ints
from gimpmd_schemas.compiled import njit

sweep = njit(nogil=True, cache=True, fastmath={"contract"})
"""Compile a sweep. It releases the interpreter lock and keeps the order of sums."""

piece = njit(
    forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True, fastmath={"contract"}
)
"""Compile a function that is inlined into sweeps."""

Weights = tuple[Vector, Vector, Vector, Vector]
Triple = tuple[float, float, float]
Place = tuple[int, int, int]
Tensor = tuple[Vector, Vector, Vector]

GIMP, BSPLINE = 0, 1
"""Kinds of interpolation: hats averaged over the domain of a point, and quadratic B-splines."""

SCALAR = (0,)
"""Axes of an array of scalars, which are handled as vectors of one component."""

NODE, ROW, PLANE = 1, 2, 3
"""Axes counted from the last one: nodes in a row, rows in a plane, and planes."""

HAT = 1e-9
"""Half-width of a point, in cells, for which the GIMP weight is the linear hat function."""


class Frames(NamedTuple):
    """Where the blocks of a mesh lie: row b describes block b.

    Attributes
    ----------
    centre : ndarray, shape ``(b, d)``
        Middle of the block (length).
    middle : ndarray, shape ``(b, d)``
        The same, in cells from the first node of the block.
    per_cell : ndarray, shape ``(b,)``
        One over the cell's edge.
    shape, strides : ndarray of int64, shape ``(b, d)``
        Nodes along each axis, and distances between them in flat arrays.
    offset : ndarray of int64, shape ``(b,)``
        Flat number of the first node.
    period : ndarray, shape ``(d,)``
        Period of the domain along each axis (length), 0 if it is not periodic.
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
    base : ndarray of int32, shape ``(n,)``
        Flat number of the first node, or ``-1 - row`` into ``detour`` where a crack cuts the
        stencil.
    w : ndarray, shape ``(n, 2, d)``
        Weights of the first and the last of the three nodes along each axis. The weight of the
        middle node follows, because weights add up to one.
    g : ndarray, shape ``(n, d)``
        Gradient (per length) of the weight of the first node. The others follow, because gradients
        add up to zero and weights reproduce positions: that of the last node is larger by one per
        cell.
    block : ndarray of int32, shape ``(n,)``
        Block of each point.
    per_cell : ndarray, shape ``(b,)``
        One over the cell's edge.
    strides : ndarray of int64, shape ``(b, d)``
        Distances between neighbouring nodes in flat arrays.
    detour : ndarray of int64, shape ``(m, 3^d)``
        Nodes of points near cracks.
    """

    axes: tuple[int, ...]
    base: Int32s
    w: Floats
    g: Floats
    block: Int32s
    per_cell: Floats
    strides: Ints
    detour: Ints


def make_stencils(block: Int32s, frames: Frames, detours: int) -> Stencils:
    """Empty stencils for points in blocks ``(n,)``; ``detours`` rows are for points near cracks."""
    n, d = block.size, frames.period.size
    return Stencils(
        axes=(0,) * d,
        base=np.zeros(n, dtype=np.int32),
        w=np.zeros((n, 2, d)),
        g=np.zeros((n, d)),
        block=block,
        per_cell=frames.per_cell,
        strides=frames.strides,
        detour=np.zeros((detours, 3**d), dtype=np.int64),
    )


@piece
def gimp(t: Vector, l: Vector) -> Weights:  # noqa: E741
    """GIMP weights along all axes at once: ``grid.interpolation.stencil`` by component.

    Parameters
    ----------
    t : vector
        Position in cells.
    l : vector
        Half-widths in cells, at most one half.

    Returns
    -------
    centre, s0, s2, g0 : vector
        The middle node of three, the weights of the other two (paper Eq. 14), and the derivative
        per cell of the first weight.
    """
    centre = floor(t + 0.5)
    r = t - centre
    left = minimum(maximum(l - r, 0.0), 2.0 * l) / (2.0 * l)  # share of the domain
    right = 1.0 - left
    s0 = maximum(-1.0 * r - l, 0.0) + l * left * left
    s2 = maximum(r - l, 0.0) + l * right * right
    return centre, s0, s2, -1.0 * left


@piece
def bspline(t: Vector) -> Weights:
    """Quadratic B-spline along all axes (Steffen et al. 2008); see ``gimp``."""
    centre = floor(t + 0.5)
    r = t - centre
    left, right = 0.5 - r, 0.5 + r
    return centre, 0.5 * left * left, 0.5 * right * right, -1.0 * left


@piece
def _point(order: Ints, k: int) -> int:
    return at(order, k) if order.size else k


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
    home: Float32s,
) -> tuple[int, int]:
    """First node and weights of every point (paper Eq. 14) into ``s.base``, ``s.w``, ``s.g``.

    Parameters
    ----------
    kind : int
        ``GIMP`` or ``BSPLINE``.
    stretch : bool
        Whether the domain of a point follows the diagonal of F (cpGIMP).
    home : ndarray of float32, shape ``(n, d)``
        Positions when the points were sorted, in cells of their block.

    Returns
    -------
    lost, drifted : int
        How many points are outside their block, and how many are more than a quarter of a cell
        away from ``home``.
    """
    axes = s.axes
    dim = len(axes)
    frequency = np.zeros(dim)
    for d in range(dim):
        if frames.period[d] > 0.0:
            frequency[d] = 1.0 / frames.period[d]
    lost, drifted = 0, 0
    for k in range(first, last):
        p = _point(order, k)
        b = np.int64(at(s.block, p))
        per_cell = at(frames.per_cell, b)
        y = load(axes, x, p) - load(axes, frames.centre, b)
        y = y - load(axes, frames.period, 0) * floor(y * load(axes, frequency, 0) + 0.5)
        middle = load(axes, frames.middle, b)
        t = y * per_cell + middle
        if kind == GIMP:
            l = load(axes, half, p)  # noqa: E741
            if stretch:
                l = l * diagonal(axes, F, p)  # noqa: E741
            centre, s0, s2, g0 = gimp(t, minimum(l, 0.5))
        else:
            centre, s0, s2, g0 = bspline(t)
        end = 2.0 * middle - 0.5  # half a cell before the last node
        base, out, far = at(frames.offset, b), False, False
        for d in range(dim):
            out |= not (0.5 <= t[d] < end[d])  # NaN is out too
            far |= abs(t[d] - at(home, dim * p + d)) > 0.25
            base += (np.int64(centre[d]) - 1) * at(frames.strides, dim * b + d)
        if out:
            lost += 1
            continue
        drifted += far
        s.base[p] = base
        store(s.w, 2 * p, s0)
        store(s.w, 2 * p + 1, s2)
        store(s.g, p, per_cell * g0)
    return lost, drifted


@piece
def _planes(s: Stencils) -> int:
    """Number of planes of nodes, along the last two axes, in a stencil."""
    return 3 if len(s.axes) > 2 else 1


@piece
def _rows(s: Stencils) -> int:
    """Number of rows of three nodes, along the last axis, in a plane of a stencil."""
    return 3 if len(s.axes) > 1 else 1


@piece
def _place(s: Stencils, p: int) -> Place:
    """First node or reference to the detour of a point; distances of planes and of rows."""
    dim, base = len(s.axes), at(s.base, p)
    if dim == 1:
        return base, 0, 0
    b = np.int64(at(s.block, p))
    return base, at(s.strides, dim * b), at(s.strides, dim * b + dim - 2)


@piece
def _weights(s: Stencils, p: int, axis: int) -> Triple:
    """Weights of the three nodes along an axis; axes are counted from the last one, which is 1."""
    if axis > len(s.axes):
        return 1.0, 0.0, 0.0
    n = (2 * p + 1) * len(s.axes) - axis
    first, last = at(s.w, n), at(s.w, n + len(s.axes))
    return first, 1.0 - first - last, last


@piece
def _slopes(s: Stencils, p: int, axis: int) -> Triple:
    """Gradients of the weights along an axis, which is counted in the same way."""
    if axis > len(s.axes):
        return 0.0, 0.0, 0.0
    first = at(s.g, (p + 1) * len(s.axes) - axis)
    last = at(s.per_cell, np.int64(at(s.block, p))) + first
    return first, -first - last, last


@piece
def _one(of: Triple, k: int) -> float:
    return of[0] if k == 0 else (of[1] if k == 1 else of[2])


@piece
def _row(s: Stencils, Q: Floats, place: Place, i: int, j: int) -> Vector:
    """Nodal values in row j of plane i of a stencil."""
    base, plane, row = place
    if base >= 0:
        return load_row(s.axes, Q, base + i * plane + j * row)
    n = 3 * (((-1 - base) * _planes(s) + i) * _rows(s) + j)
    return join(
        load(s.axes, Q, at(s.detour, n)),
        load(s.axes, Q, at(s.detour, n + 1)),
        load(s.axes, Q, at(s.detour, n + 2)),
    )


@piece
def _add_row(s: Stencils, Q: Floats, place: Place, i: int, j: int, values: Vector) -> None:
    """Add to the nodes in row j of plane i of a stencil."""
    base, plane, row = place
    if base >= 0:
        deposit_row(Q, base + i * plane + j * row, values)
        return
    n = 3 * (((-1 - base) * _planes(s) + i) * _rows(s) + j)
    deposit(Q, at(s.detour, n), part(values, 0))
    deposit(Q, at(s.detour, n + 1), part(values, 1))
    deposit(Q, at(s.detour, n + 2), part(values, 2))


@piece
def _interpolate(s: Stencils, p: int, Q: Floats) -> Vector:
    """``sum_i S_ip Q_i``."""
    place, w_plane, w_row = _place(s, p), _weights(s, p, PLANE), _weights(s, p, ROW)
    total = zero_row(s.axes)
    for i in range(_planes(s)):
        plane = zero_row(s.axes)
        for j in range(_rows(s)):
            plane = plane + _one(w_row, j) * _row(s, Q, place, i, j)
        total = total + _one(w_plane, i) * plane
    return contract(_weights(s, p, NODE), total)


@piece
def _distribute(s: Stencils, p: int, q: Vector, Q: Floats) -> None:
    """``Q_i += S_ip q``."""
    place, w_plane, w_row = _place(s, p), _weights(s, p, PLANE), _weights(s, p, ROW)
    whole = outer(_weights(s, p, NODE), q)
    for i in range(_planes(s)):
        plane = _one(w_plane, i) * whole
        for j in range(_rows(s)):
            _add_row(s, Q, place, i, j, _one(w_row, j) * plane)


@sweep
def scatter_mass(order: Ints, first: int, last: int, s: Stencils, mass: Floats, M: Floats) -> None:
    """Nodal mass, ``M_i += S_ip m_p`` (paper section 3.1)."""
    for k in range(first, last):
        p = _point(order, k)
        _distribute(s, p, load(SCALAR, mass, p), M)


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
    for k in range(first, last):
        p = _point(order, k)
        place, w_plane, w_row = _place(s, p), _weights(s, p, PLANE), _weights(s, p, ROW)
        w = _weights(s, p, NODE)
        m = outer(w, load(SCALAR, mass, p))
        momentum = outer(w, at(mass, p) * load(s.axes, v, p))
        for i in range(_planes(s)):
            for j in range(_rows(s)):
                weight = _one(w_plane, i) * _one(w_row, j)
                _add_row(s, M, place, i, j, weight * m)
                _add_row(s, P, place, i, j, weight * momentum)


@sweep
def scatter_vector(
    order: Ints, first: int, last: int, s: Stencils, mass: Floats, q: Floats, Q: Floats
) -> None:
    """Momentum of a point field, ``Q_i += S_ip m_p q_p``."""
    for k in range(first, last):
        p = _point(order, k)
        _distribute(s, p, at(mass, p) * load(s.axes, q, p), Q)


@piece
def _distribute_force(s: Stencils, p: int, V: float, tau: Tensor, J: Floats) -> None:
    """``J_i += V tau . grad S_ip``, with the rows of tau for planes, rows and nodes."""
    place, w = _place(s, p), _weights(s, p, NODE)
    w_plane, g_plane = _weights(s, p, PLANE), _slopes(s, p, PLANE)
    w_row, g_row = _weights(s, p, ROW), _slopes(s, p, ROW)
    tau_plane, tau_row = outer(w, V * tau[0]), outer(w, V * tau[1])
    tau_node = outer(_slopes(s, p, NODE), V * tau[2])
    for i in range(_planes(s)):
        plane = _one(w_plane, i) * tau_node
        if len(s.axes) > 2:
            plane = plane + _one(g_plane, i) * tau_plane
        across = _one(w_plane, i) * tau_row
        for j in range(_rows(s)):
            force = _one(w_row, j) * plane + _one(g_row, j) * across
            _add_row(s, J, place, i, j, force)


@piece
def _tensor(axes: tuple[int, ...], T: Floats, p: int) -> Tensor:
    """Rows of the tensor of a point that belong to planes, rows and nodes of its stencil."""
    dim = len(axes)
    return (
        load(axes, T, dim * p),
        load(axes, T, dim * p + max(dim - ROW, 0)),
        load(axes, T, dim * p + dim - NODE),
    )


@piece
def _nominal(axes: tuple[int, ...], F: Floats, tau: Tensor, p: int) -> Tensor:
    """Nominal stress of a point, ``N = F^-1 tau``; see ``_tensor`` for the order of rows.

    N is the transpose of the first Piola-Kirchhoff stress. Its rows are contracted with gradients
    in the reference configuration in the same way as those of tau with present gradients.
    """
    dim, n = len(axes), len(axes) * len(axes) * p
    if dim == 1:
        scale = 1.0 / at(F, n)
        return scale * tau[0], scale * tau[1], scale * tau[2]
    if dim == 2:
        a, b, c, d = at(F, n), at(F, n + 1), at(F, n + 2), at(F, n + 3)
        scale = 1.0 / (a * d - b * c)
        row = scale * (d * tau[1] - b * tau[2])
        return row, row, scale * (a * tau[2] - c * tau[1])
    a, b, c = at(F, n), at(F, n + 1), at(F, n + 2)
    d, e, f = at(F, n + 3), at(F, n + 4), at(F, n + 5)
    g, h, i = at(F, n + 6), at(F, n + 7), at(F, n + 8)
    A, B, C = e * i - f * h, f * g - d * i, d * h - e * g
    scale = 1.0 / (a * A + b * B + c * C)
    return (
        scale * (A * tau[0] + (c * h - b * i) * tau[1] + (b * f - c * e) * tau[2]),
        scale * (B * tau[0] + (a * i - c * g) * tau[1] + (c * d - a * f) * tau[2]),
        scale * (C * tau[0] + (b * g - a * h) * tau[1] + (a * e - b * d) * tau[2]),
    )


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
        One for a force, the time step for an impulse.
    volume : ndarray, shape ``(n,)``
        Reference volume, since tau is the Kirchhoff stress: ``V sigma = V_0 tau``.
    stress : ndarray, shape ``(n, d, d)``
        Kirchhoff stress.
    """
    for k in range(first, last):
        p = _point(order, k)
        _distribute_force(s, p, -factor * at(volume, p), _tensor(s.axes, stress, p), J)


@sweep
def scatter_nominal_force(
    order: Ints,
    first: int,
    last: int,
    s: Stencils,
    factor: float,
    volume: Floats,
    F: Floats,
    stress: Floats,
    J: Floats,
) -> None:
    """Internal force with gradients in the reference configuration, ``tau_p`` as ``F_p^-1 tau_p``.

    The other parameters are those of ``scatter_force``.
    """
    for k in range(first, last):
        p = _point(order, k)
        N = _nominal(s.axes, F, _tensor(s.axes, stress, p), p)
        _distribute_force(s, p, -factor * at(volume, p), N, J)


@sweep
def gather_vector(
    order: Ints, first: int, last: int, s: Stencils, Q: Floats, factor: float, q: Floats
) -> None:
    """Add a nodal field to the points: ``q_p += factor sum_i S_ip Q_i`` (paper Eq. 5)."""
    for k in range(first, last):
        p = _point(order, k)
        deposit(q, p, factor * _interpolate(s, p, Q))


@piece
def _add_sums(row: int, squares: Vector, momentum: Vector, sums: Floats) -> None:
    """Add to the sums of a stripe, unless ``row`` is -1."""
    if row >= 0:
        for d in range(sums.shape[1] - 1):
            sums[row, 0] += squares[d]
            sums[row, 1 + d] += momentum[d]


@sweep
def kick(
    order: Ints,
    first: int,
    last: int,
    s: Stencils,
    dV: Floats,
    mass: Floats,
    v: Floats,
    dv: Floats,
    P: Floats,
    share: float,
    stripe: Ints,
    sums: Floats,
) -> None:
    """Kick the points and add their new momentum to the nodes, in one sweep.

    ``dv_p = sum_i S_ip dV_i``, ``v_p += dv_p`` (FLIP), ``P_i += S_ip m_p v_p``.

    Parameters
    ----------
    dV : ndarray, shape ``(size, d)``
        Change of the nodal velocity: impulse over nodal mass.
    sums : ndarray, shape ``(s, 1 + d)``
        Kinetic energy and momentum of the points of each stripe are added here, at the velocity
        after ``share`` of the kick.
    stripe : ndarray of int64, shape ``(n,)``
    """
    row = -1
    squares, momentum = zero(s.axes), zero(s.axes)  # of the stripe, in registers
    for k in range(first, last):
        p = _point(order, k)
        change = _interpolate(s, p, dV)
        old = load(s.axes, v, p)
        new = old + change
        store(dv, p, change)
        store(v, p, new)
        _distribute(s, p, at(mass, p) * new, P)
        if at(stripe, p) != row:
            _add_sums(row, squares, momentum, sums)
            squares, momentum, row = zero(s.axes), zero(s.axes), at(stripe, p)
        between = old + share * change
        squares = squares + 0.5 * at(mass, p) * (between * between)
        momentum = momentum + at(mass, p) * between
    _add_sums(row, squares, momentum, sums)


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
    """Deform, and move if ``x_step`` is not zero, the points with a nodal velocity (Eqs. 5, 7, 8).

    ``F <- (I + dt L) F`` if ``finite``, else ``F += dt L``, with ``L = sum_i V_i grad S_ip``;
    ``x += x_step sum_i S_ip V_i``.
    """
    axes = s.axes
    dim = len(axes)
    unit = np.eye(dim)
    for k in range(first, last):
        p = _point(order, k)
        place, w = _place(s, p), _weights(s, p, NODE)
        w_plane, g_plane = _weights(s, p, PLANE), _slopes(s, p, PLANE)
        w_row, g_row = _weights(s, p, ROW), _slopes(s, p, ROW)
        empty = zero_row(axes)
        total, planes, rows = empty, empty, empty
        for i in range(_planes(s)):
            plane, across = empty, empty
            for j in range(_rows(s)):
                row = _row(s, V, place, i, j)
                plane = plane + _one(w_row, j) * row
                across = across + _one(g_row, j) * row
            total = total + _one(w_plane, i) * plane
            planes = planes + _one(g_plane, i) * plane
            rows = rows + _one(w_plane, i) * across
        if x_step != 0.0:
            deposit(x, p, x_step * contract(w, total))
        # columns of dt L, and the rows of F that they are multiplied with
        L_plane, L_row = dt * contract(w, planes), dt * contract(w, rows)
        L_node = dt * contract(_slopes(s, p, NODE), total)
        if finite:
            F_plane = load(axes, F, dim * p)
            F_row = load(axes, F, dim * p + max(dim - ROW, 0))
            F_node = load(axes, F, dim * p + dim - NODE)
        else:
            F_plane, F_row = load(axes, unit, 0), load(axes, unit, max(dim - ROW, 0))
            F_node = load(axes, unit, dim - NODE)
        for d in range(dim):
            change = L_node[d] * F_node
            if dim > 1:
                change = change + L_row[d] * F_row
            if dim > 2:
                change = change + L_plane[d] * F_plane
            deposit(F, dim * p + d, change)


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
        p = _point(order, k)
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
def clear(axes: tuple[int, ...], runs: Ints, field: Floats) -> None:
    """Set a nodal field ``(size, len(axes))`` to zero in runs of nodes.

    Row k of ``runs``, shape ``(n, 2)``, is the first node of a run and the one after its last.
    """
    for k in range(runs.shape[0]):
        for i in range(runs[k, 0], runs[k, 1]):
            store(field, i, zero(axes))


@sweep
def clear_touched(axes: tuple[int, ...], nodes: Ints, M: Floats, field: Floats) -> None:
    """Set a nodal field to zero at those of some nodes where a mass is not zero."""
    for n in range(nodes.size):
        i = at(nodes, n)
        if at(M, i) > 0.0:
            store(field, i, zero(axes))


@sweep
def divide(
    axes: tuple[int, ...], nodes: Ints, P: Floats, M: Floats, floor: float, V: Floats
) -> None:
    """Nodal velocity ``V_i = P_i / M_i``, zero where the nodal mass does not exceed ``floor``."""
    for n in range(nodes.size):
        i = at(nodes, n)
        inverse = 1.0 / at(M, i) if at(M, i) > floor else 0.0
        store(V, i, inverse * load(axes, P, i))


@sweep
def add(axes: tuple[int, ...], nodes: Ints, Q: Floats, factor: float, into: Floats) -> None:
    """``into_i += factor Q_i`` at some nodes."""
    for n in range(nodes.size):
        i = at(nodes, n)
        deposit(into, i, factor * load(axes, Q, i))


@sweep
def damp_change(
    nodes: Ints, C: Floats, M: Floats, floor: float, V: Floats, dV: Floats, loads: Floats
) -> None:
    """Let dashpots act in a kick: ``M dV = J - C (V + dV / 2)``, stable for any C.

    Parameters
    ----------
    C : ndarray, shape ``(size, d)``
        Viscous coefficient of the dashpots times the length of the kick.
    floor : float
        Nodes with at most this mass are left alone.
    dV : ndarray, shape ``(size, d)``
        ``J / M`` on entry.
    loads : ndarray, shape ``(size, d)``
        The impulse of the dashpots is added here.
    """
    for n in range(nodes.size):
        i = nodes[n]
        if M[i] <= floor:
            continue
        for d in range(C.shape[1]):
            if C[i, d] > 0.0:
                dV[i, d] = (M[i] * dV[i, d] - C[i, d] * V[i, d]) / (M[i] + 0.5 * C[i, d])
                loads[i, d] -= C[i, d] * (V[i, d] + 0.5 * dV[i, d])


@sweep
def inertia(axes: tuple[int, ...], nodes: Ints, M: Floats, dV: Floats, J: Floats) -> None:
    """``J_i -= M_i dV_i``: the part of an impulse that does not accelerate a mass."""
    for n in range(nodes.size):
        i = at(nodes, n)
        deposit(J, i, -at(M, i) * load(axes, dV, i))


@sweep
def carrying(axes: tuple[int, ...], nodes: Ints, J: Floats, counts: Floats) -> Ints:
    """Those of some nodes that count and have an impulse."""
    found, size = np.empty_like(nodes), 0
    for n in range(nodes.size):
        i = at(nodes, n)
        part = load(axes, J, i)
        moved = False
        for d in range(len(axes)):
            moved |= part[d] != 0.0
        if moved and at(counts, i) != 0.0:
            found[size] = i
            size += 1
    return found[:size]


@sweep
def work(axes: tuple[int, ...], nodes: Ints, J: Floats, V: Floats, counts: Floats) -> float:
    """``sum_i counts_i J_i . V_i`` over some nodes."""
    total = zero(axes)
    for n in range(nodes.size):
        i = at(nodes, n)
        total = total + at(counts, i) * (load(axes, J, i) * load(axes, V, i))
    summed = 0.0
    for d in range(len(axes)):
        summed += total[d]
    return summed

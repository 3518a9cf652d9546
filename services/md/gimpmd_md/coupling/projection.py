"""From atoms to nodes and back: lumped and consistent projection (paper section 3.1).

Atoms have the uGIMP weights of the background grid (paper Eq. 14), with half the atomic spacing as
their half-width. One sweep over the atoms sums the nodal mass, the momentum and the rows of the
consistent mass matrix. Everything after that works on nodes only.
"""

from __future__ import annotations

from functools import reduce
from itertools import product
from typing import NamedTuple

import numpy as np

from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.compiled import njit
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.background import PAD, BackgroundGrid
from gimpmd_schemas.grid.particle_grid import Window, fill, gather, gimp_weights

ITERATIONS = 3
"""Corrections of the consistent projection; with fewer the coupling is unstable (the paper: 0)."""

LEAST_EIGENVALUE = 0.4
"""Least eigenvalue of the mass matrix, over the lumped mass, that the corrections resolve.

Along an axis the eigenvalues are 1 for long waves and 1/3 for a wavelength of two cells, which no
grid carries. With 1/3 the projection is sharper, and the coupling is less stable.
"""

CORRECTION_CELLS = 2 * ITERATIONS
"""Distance (cells) up to which a nodal sum affects a corrected velocity.

An atom connects nodes up to two cells apart, and each correction extends this by two more.
"""

_RIM = 2  # nodes around the window that no atom touches, so that matrix rows need no branches


def sums_per_node(dim: int) -> int:
    """Number of sums of a node: mass, momentum, and its row of the mass matrix.

    The row holds ``sum_a S_ia m_a S_ja`` for the nodes j that are 0 to 2 nodes further along the
    first axis and -2 to 2 nodes further along the others. This is enough, since the matrix is
    symmetric.
    """
    return 1 + dim + 3 * 5 ** (dim - 1)


def step_sizes(iterations: int) -> Floats:
    """Factors of the corrections: Chebyshev semi-iteration for eigenvalues up to one.

    The eigenvalues begin at ``LEAST_EIGENVALUE``. Three such corrections do as much as eight of
    unit size. So many are necessary where the crystal ends. The last nodes there have atoms on one
    side only, their lumped velocities belong to other places, and what the corrections leave of
    this error shifts the atoms' field by a part of a cell. The two sides would then meet at
    slightly different places, and gain or lose energy at any wavelength.

    Returns
    -------
    ndarray, shape ``(iterations,)``
    """
    angle = np.pi / max(iterations, 1) * (np.arange(iterations) + 0.5)
    middle, half = 0.5 * (1.0 + LEAST_EIGENVALUE), 0.5 * (1.0 - LEAST_EIGENVALUE)
    return np.asarray(1.0 / (middle - half * np.cos(angle)))


class _Frame(NamedTuple):
    """How kernels find the stencil of an atom; tuples have one entry for each axis.

    Attributes
    ----------
    origin, cell : corner of the grid, and edge of its cells (length).
    half_width : half-width of an atom (cells).
    period : cells after which the grid repeats, or 0.
    low : atoms are shifted by periods to lie above this coordinate (cells).
    window : the nodes of the fields.
    usable : whether all nodes of a stencil that begins at this node are known.
    """

    origin: tuple[float, ...]
    cell: float
    half_width: float
    period: tuple[float, ...]
    low: tuple[float, ...]
    window: Window
    usable: Bools


class NodeMap:
    """The nodes of a rank in a rectangular window, and the stencils of atoms of one spacing.

    Along a periodic axis the window either spans the whole period, including images of the first
    and last nodes, or a part of it without images. Atoms are shifted by periods into the window.
    Fields over the window are flat arrays of ``size`` rows.

    Parameters
    ----------
    grid : BackgroundGrid
    nodes : ndarray of int64
        Ids of canonical nodes, ascending. The window is the smallest one that holds them.
    spacing : float
        Distance of neighbouring atoms, the d-th root of the volume per atom; at most one cell.

    Attributes
    ----------
    size : int
        Number of nodes of the window.
    """

    def __init__(self, grid: BackgroundGrid, nodes: Ints, spacing: float) -> None:
        d = grid.dim
        places = np.unravel_index(nodes, grid.shape)
        axes = [
            _axis_nodes(cells, periodic, np.unique(place) - PAD)
            for cells, periodic, place in zip(grid.cells, grid.periodic, places, strict=True)
        ]
        shape = tuple(indices.size + 2 * _RIM for indices, _ in axes)
        self.size = int(np.prod(shape))
        self._strides = tuple(int(np.prod(shape[axis + 1 :])) for axis in range(d))

        ids = np.full(shape, -1, dtype=np.int64)
        wrapped = (
            (indices % n if periodic else indices) + PAD
            for (indices, _), n, periodic in zip(axes, grid.cells, grid.periodic, strict=True)
        )
        inside = np.ravel_multi_index(np.ix_(*wrapped), grid.shape)
        ids[(slice(_RIM, -_RIM),) * d] = np.where(np.isin(inside, nodes), inside, -1)
        self._frame = _Frame(
            origin=grid.origin,
            cell=grid.cell,
            half_width=0.5 * spacing / grid.cell,
            period=tuple(
                float(n) if p else 0.0 for n, p in zip(grid.cells, grid.periodic, strict=True)
            ),
            low=tuple(low for _, low in axes),
            window=Window(
                first=tuple(int(indices[0]) - _RIM for indices, _ in axes),
                shape=shape,
                period=(0,) * d,  # atoms are shifted instead
            ),
            usable=_usable(ids >= 0).ravel(),
        )

        ids = ids.ravel()
        self._place = np.full(grid.size, -1, dtype=np.int64)
        known = np.flatnonzero(ids >= 0)
        # of a node and its image, the one that has all its neighbours represents both
        first_choice = known[np.argsort(_is_image(grid, axes)[known], kind="stable")]
        _, which = np.unique(ids[first_choice], return_index=True)
        self._place[ids[first_choice[which]]] = first_choice[which]
        self._images = known[self._place[ids[known]] != known]
        self._imaged = self._place[ids[self._images]]
        self._ids = ids

    def places(self, nodes: Ints) -> Ints:
        """Rows of the nodes with these ids in fields over the window."""
        return np.asarray(self._place[nodes], dtype=np.int64)

    def spread(self, nodes: Ints) -> tuple[Ints, Ints]:
        """Rows of these nodes and of all their images, and the index in ``nodes`` for each row."""
        order = np.full(self._place.size, -1, dtype=np.int64)
        order[nodes] = np.arange(nodes.size)
        shown = np.where(self._ids >= 0, order[self._ids], -1)
        rows = np.flatnonzero(shown >= 0)
        return rows, shown[rows]

    def assemble(
        self, role: Ints, bits: int, m: Floats, x: Floats, q: Floats, back: float
    ) -> tuple[Floats, int]:
        """Nodal sums of the atoms that have one of the bits.

        Parameters
        ----------
        role : ndarray of int, shape ``(n,)``
        bits : int
        m : ndarray, shape ``(n,)``
            Masses.
        x, q : ndarray, shape ``(n, d)``
            Positions and velocities.
        back : float
            The stencils are those at the positions ``x - back q``.

        Returns
        -------
        sums : ndarray, shape ``(size, sums_per_node(d))``
            Column 0 is the mass, columns 1 to d are the momentum ``sum_a S_ia m_a q_a``. The sums
            of periodic images are at the nodes that they repeat.
        stray : int
            Index of an atom that touches a node that is not in the set, or -1. If there is one, the
            sums are of no use.
        """
        sums = np.zeros((self.size, sums_per_node(len(self._strides))))
        stray = _assemble(role, bits, m, x, q, back, self._frame, self._strides, sums.reshape(-1))
        if self._images.size:
            np.add.at(sums, self._imaged, sums[self._images])
            sums[self._images] = 0.0
        return sums, int(stray)

    def solve(self, sums: Floats, iterations: int = ITERATIONS) -> Floats:
        """Nodal velocity from nodal sums over all ranks.

        It starts from the lumped velocity ``V_i = sum_a S_ia m_a q_a / M_i`` (paper section 3.1).
        Each correction adds the projection of the remainder at the atoms, ``q_a - sum_i S_ia V_i``,
        times a factor from ``step_sizes``. The result tends to the velocity whose interpolation
        fits the atoms best (consistent mass matrix).

        Parameters
        ----------
        sums : ndarray, shape ``(size, sums_per_node(d))``
        iterations : int
            Number of corrections; 0 gives the lumped velocity.

        Returns
        -------
        ndarray, shape ``(size, d)``
            Valid at a distance of ``CORRECTION_CELLS`` from nodes whose sums are incomplete.
        """
        d = len(self._strides)
        velocity, rest = (np.zeros((self.size, d + d % 2)) for _ in range(2))
        steps = step_sizes(iterations)
        _solve(sums, self._strides, self._images, self._imaged, steps, velocity, rest)
        return velocity[:, :d]

    def follow(self, role: Ints, bits: int, x: Floats, field: Floats, v: Floats) -> bool:
        """Set the velocity of the atoms that have one of the bits to ``sum_i S_ia V_i``.

        Parameters
        ----------
        role, bits, x
            As for ``project``.
        field : ndarray, shape ``(size, d)``
            Nodal velocities, NaN where they are unknown.
        v : ndarray, shape ``(n, d)``
            Changed in place.

        Returns
        -------
        bool
            Whether all nodes that the atoms touch are in the set and have known velocities.
        """
        return bool(_follow(role, bits, x, self._frame, self._strides, field, v))


def _axis_nodes(cells: int, periodic: bool, present: Ints) -> tuple[Ints, float]:
    """Indices of the nodes of the window along an axis.

    The second result is the coordinate (cells) from which on a period of atoms lies in the window.

    Parameters
    ----------
    cells : int
        Number of cells of the grid along the axis.
    periodic : bool
    present : ndarray of int64
        Indices of the nodes that the window must hold, ascending.
    """
    if not periodic:
        return np.arange(present[0], present[-1] + 1), 0.0
    if present.size == cells:
        return np.arange(-PAD, cells + PAD + 1), 0.0
    following = np.append(present[1:], present[0] + cells)
    widest = int(np.argmax(following - present))
    first, last = int(following[widest]), int(present[widest]) + cells  # around the widest gap
    if first + last >= 2 * cells:  # the middle of the window lies in the domain
        first, last = first - cells, last - cells
    return np.arange(first, last + 1), 0.5 * (first + last - cells)


def _usable(known: Bools) -> Bools:
    """At which nodes a stencil may begin: all of its ``3^d`` nodes are known."""
    usable = np.zeros_like(known)
    begin = tuple(slice(0, n - 2) for n in known.shape)
    stencil = product(*([slice(i, n - 2 + i) for i in range(3)] for n in known.shape))
    usable[begin] = reduce(np.logical_and, (known[node] for node in stencil))
    return usable


def _is_image(grid: BackgroundGrid, axes: list[tuple[Ints, float]]) -> Bools:
    """Which nodes of the window, including the rim, are images in a window of a whole period."""
    beyond = []
    for axis, (indices, low) in enumerate(axes):
        whole = (
            grid.periodic[axis] and low == 0.0 and indices.size == grid.cells[axis] + 1 + 2 * PAD
        )
        outside = (indices < 0) | (indices >= grid.cells[axis])
        beyond.append(np.pad(outside & whole, _RIM))
    return np.asarray(reduce(np.logical_or.outer, beyond).ravel(), dtype=np.bool_)


def left_the_grid(x: Floats) -> BackendError:
    """The error about an atom at a position that touches nodes which no rank holds."""
    position = ", ".join(f"{c:g}" for c in x)
    return BackendError(
        f"an atom at ({position}) has left the background grid: the body has moved too far, or the "
        "run is unstable (see the temperature in log.lammps)"
    )


@njit(inline="always")
def _coordinates(frame, x, back, q, t):  # type: ignore[no-untyped-def]
    """Set ``t`` to the position ``x - back q`` in cells, shifted by periods into the window."""
    for axis in range(len(frame.origin)):
        c = (x[axis] - back * q[axis] - frame.origin[axis]) / frame.cell
        period = frame.period[axis]
        if period > 0.0:
            c -= period * np.floor((c - frame.low[axis]) / period)
        t[axis] = c


@njit(inline="always")
def _first_node(frame, strides, base):  # type: ignore[no-untyped-def]
    """Row of the first node of a stencil, or -1 if the atom touches an unknown node."""
    d = len(strides)
    first, shape = frame.window.first, frame.window.shape
    i, k = base[0] - first[0], base[2] - first[d - 1]
    inside = 0 <= i < shape[0] and 0 <= k < shape[d - 1]
    node = i * strides[0] + k
    if d == 3:
        j = base[1] - first[1]
        inside = inside and 0 <= j < shape[1]
        node += j * strides[1]
    return node if inside and frame.usable[node] else -1


@njit(cache=True)
def _assemble(role, bits, m, x, q, back, frame, strides, sums):  # type: ignore[no-untyped-def]
    """Add the atoms' mass, momentum and mass matrix; the index of a stray atom, or -1."""
    d = len(strides)
    width, middle_nodes = sums.size // frame.usable.size, 3 if d == 3 else 1
    line = 5 * (5 if d == 3 else 1)  # matrix entries of one step along the first axis
    t, half = np.empty(d), np.full(d, frame.half_width)
    for a in range(role.shape[0]):
        if not role[a] & bits:
            continue
        _coordinates(frame, x[a], back, q[a], t)
        base, first, middle, last = gimp_weights(t, half, d)
        node = _first_node(frame, strides, base)
        if node < 0:
            return a
        s0, s1, s2 = last
        for i in range(3):
            for j in range(middle_nodes):
                wij = m[a] * first[i] * middle[j]
                for k in range(3):
                    at = width * (node + i * strides[0] + (j * strides[1] if d == 3 else 0) + k)
                    w = wij * last[k]
                    sums[at] += w
                    for axis in range(d):
                        sums[at + 1 + axis] += w * q[a, axis]
                    at += 1 + d + 2 - k
                    if d == 3:
                        at += 5 * (2 - j)
                    for e in range(3 - i):
                        for f in range(middle_nodes):
                            c = w * first[i + e] * middle[f]
                            sums[at + line * e + 5 * f] += c * s0
                            sums[at + line * e + 5 * f + 1] += c * s1
                            sums[at + line * e + 5 * f + 2] += c * s2
    return -1


@njit(cache=True)
def _solve(sums, strides, images, imaged, steps, velocity, rest):  # type: ignore[no-untyped-def]
    """Lumped velocity, then its corrections ``V += step M^-1 (P - C V)``, components in pairs."""
    d, size = len(strides), sums.shape[0]
    for i in range(size):
        if sums[i, 0] > 0.0:
            for axis in range(d):
                velocity[i, axis] = sums[i, 1 + axis] / sums[i, 0]
    for step in steps:
        for k in range(images.size):
            velocity[images[k]] = velocity[imaged[k]]
        rest[:] = 0.0
        for i in range(size):
            if sums[i, 0] > 0.0:
                for pair in range((d + 1) // 2):
                    _subtract(sums, strides, i, 2 * pair, velocity, rest)
        for k in range(images.size):
            rest[imaged[k]] += rest[images[k]]
        for i in range(size):
            if sums[i, 0] > 0.0:
                for axis in range(d):
                    velocity[i, axis] += step * rest[i, axis] / sums[i, 0]
    for k in range(images.size):
        velocity[images[k]] = velocity[imaged[k]]


@njit(inline="always")
def _subtract(sums, strides, i, x, velocity, rest):  # type: ignore[no-untyped-def]
    """Add ``P - C V`` to the rest, for row i of C and its mirror image, components x and x + 1."""
    d = len(strides)
    y, lines = x + 1, 5 if d == 3 else 1
    rx, ry = sums[i, 1 + x], sums[i, 1 + y] if y < d else 0.0
    vx, vy = velocity[i, x], velocity[i, y]
    for f in range(lines):
        near = i + ((f - 2) * strides[1] if d == 3 else 0) - 2
        for n in range(5):
            c = sums[i, 1 + d + 5 * f + n]
            rx -= c * velocity[near + n, x]
            ry -= c * velocity[near + n, y]
    for e in range(1, 3):
        for f in range(lines):
            near = i + e * strides[0] + ((f - 2) * strides[1] if d == 3 else 0) - 2
            for n in range(5):
                c = sums[i, 1 + d + 5 * (lines * e + f) + n]
                rx -= c * velocity[near + n, x]
                ry -= c * velocity[near + n, y]
                rest[near + n, x] -= c * vx
                rest[near + n, y] -= c * vy
    rest[i, x] += rx
    rest[i, y] += ry


@njit(cache=True)
def _follow(role, bits, x, frame, strides, field, v):  # type: ignore[no-untyped-def]
    """Interpolate; whether all nodes were in the set and all values finite."""
    d, finite = len(strides), True
    t, half = np.empty(d), np.full(d, frame.half_width)
    nodes, S = np.empty(3**d, np.int64), np.empty(3**d)
    for a in range(role.shape[0]):
        if not role[a] & bits:
            continue
        _coordinates(frame, x[a], 0.0, x[a], t)
        base, first, middle, last = gimp_weights(t, half, d)
        if _first_node(frame, strides, base) < 0:
            return False
        fill(frame.window, base, first, middle, last, nodes, S)
        gather(nodes, S, field, v[a], 3**d, d)
        for axis in range(d):
            finite &= np.isfinite(v[a, axis])
    return finite

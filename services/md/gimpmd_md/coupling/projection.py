"""From atoms to nodes and back: lumped and consistent projection (paper section 3.1).

Atoms carry the uGIMP weights of the background grid (paper Eq. 14); the half-width of an atom is
half the spacing of the lattice. One sweep over the atoms sums nodal mass, momentum and the rows of
the consistent mass matrix; what remains is a matter of nodes alone.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit

from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.background import PAD, BackgroundGrid
from gimpmd_schemas.grid.interpolation import stencil
from gimpmd_schemas.grid.zones import Box

ITERATIONS = 3
"""Corrections of the consistent projection; fewer leave the coupling unstable (the paper: none)."""

SOFTEST = 0.4
"""Least eigenvalue of the mass matrix, over the lumped mass, whose modes the corrections go for.

Along an axis these are 1 for long waves and 1/3 for a wave of two cells, which no grid carries:
with 1/3 its projection is sharper and the coupling less stable.
"""

REACH_CELLS = 2 * ITERATIONS
"""How far, in cells, nodal sums must be whole: an atom ties nodes up to two cells apart."""

SUMS = 18
"""Sums of a node: mass, momentum (2), and its row of the mass matrix (15).

The row holds ``sum_a S_ia m_a S_ja`` for the nodes j in the same grid line and the next two, five
each, from two before to two behind; the matrix is symmetric, so this is all of it.
"""

_ROW = 3  # where the row begins
_RIM = 2  # nodes around the window that no atom touches, so that rows need no branches


def step_sizes(iterations: int) -> Floats:
    """Factors of the corrections: Chebyshev's semi-iteration on eigenvalues from SOFTEST to 1.

    Three do what eight of unit size would. It takes that much where the crystal ends: the last
    nodes see atoms on one side alone, lumped velocities are those of other places there, and what
    corrections leave of that shifts the atoms' field by a part of a cell. Both sides would then
    meet a little beside the same place, and gain or lose energy at any wavelength.

    Returns
    -------
    ndarray, shape ``(iterations,)``
    """
    angle = np.pi / max(iterations, 1) * (np.arange(iterations) + 0.5)
    middle, half = 0.5 * (1.0 + SOFTEST), 0.5 * (1.0 - SOFTEST)
    return np.asarray(1.0 / (middle - half * np.cos(angle)))


class NodeMap:
    """The nodes of a patch as a rectangular window, and how atoms of one spacing see them.

    Along a periodic axis the window is all of it, with the images of the first and last nodes, or
    a part without any; atoms are shifted by periods into it. Fields over the window are flat
    arrays of ``size`` rows.

    Parameters
    ----------
    grid : BackgroundGrid
    nodes : ndarray of int64
        Ids of the canonical nodes of the patch, ascending; atoms that touch others are strays.
    box : Box
        The window is the least one that holds the nodes within reach of this box: the patch.
    reach : float
        In cells.
    spacing : float
        Distance of atoms, ``sqrt(area per atom)``; at most one cell.

    Attributes
    ----------
    size : int
        Number of nodes of the window.
    """

    def __init__(
        self, grid: BackgroundGrid, nodes: Ints, box: Box, reach: float, spacing: float
    ) -> None:
        self._cell = grid.cell
        self._half_width = 0.5 * spacing / grid.cell
        self._period = np.where(grid.periodic, grid.cells, 0).astype(np.float64)
        axes = [_window(grid, axis, box[axis], reach) for axis in range(2)]
        self._low = np.array([low for _, low in axes])
        first = [indices[0] - _RIM for indices, _ in axes]
        shape = tuple(indices.size + 2 * _RIM for indices, _ in axes)
        self._columns = shape[1]
        self.size = shape[0] * shape[1]
        self._origin = np.array(grid.origin)
        self._first = np.array(first, dtype=np.int64)

        inside = np.full(shape, -1, dtype=np.int64)
        rows, columns = (
            indices % grid.cells[axis] if grid.periodic[axis] else indices
            for axis, (indices, _) in enumerate(axes)
        )
        ids = (rows[:, None] + PAD) * grid.shape[1] + columns[None, :] + PAD
        inside[_RIM:-_RIM, _RIM:-_RIM] = np.where(np.isin(ids, nodes), ids, -1)
        ids = inside.ravel()
        self._known = (ids >= 0).reshape(shape)
        self._place = np.full(grid.size, -1, dtype=np.int64)
        known = np.flatnonzero(ids >= 0)
        # of a node and its image the one that has all its neighbours stands for both
        standing = known[np.argsort(_is_image(grid, axes)[known], kind="stable")]
        _, which = np.unique(ids[standing], return_index=True)
        self._place[ids[standing[which]]] = standing[which]
        self._images = known[self._place[ids[known]] != known]
        self._imaged = self._place[ids[self._images]]
        self._ids = ids

    def places(self, nodes: Ints) -> Ints:
        """Rows of the nodes with these ids in fields over the window."""
        return np.asarray(self._place[nodes], dtype=np.int64)

    def spread(self, nodes: Ints) -> tuple[Ints, Ints]:
        """Rows of these nodes and of all their images, and which of the nodes each shows."""
        order = np.full(self._place.size, -1, dtype=np.int64)
        order[nodes] = np.arange(nodes.size)
        shown = np.where(self._ids >= 0, order[self._ids], -1)
        rows = np.flatnonzero(shown >= 0)
        return rows, shown[rows]

    def project(
        self,
        part: Ints,
        bits: int,
        m: Floats,
        x: Floats,
        q: Floats,
        back: float,
        complete: Callable[[Floats], None],
        iterations: int = ITERATIONS,
    ) -> tuple[Floats, Floats]:
        """Nodal mass, momentum and velocity of the atoms that have one of the bits.

        The lumped velocity ``V_i = sum_a S_ia m_a q_a / M_i`` (paper section 3.1) is corrected by
        the projection of what it leaves at the atoms, ``q_a - sum_i S_ia V_i``; this tends to the
        velocity whose interpolation fits the atoms best (consistent mass matrix). Corrections are
        weighted with ``step_sizes``.

        Parameters
        ----------
        part : ndarray of int, shape ``(n,)``
        bits : int
        m : ndarray, shape ``(n,)``
            Masses.
        x, q : ndarray, shape ``(n, 2)``
            Positions and velocities.
        back : float
            The atoms are seen at ``x - back q``.
        complete : callable
            Completes nodal sums, shape ``(size, SUMS)``, over the patches, in place.
        iterations : int
            Corrections; 0 leaves the lumped velocity.

        Returns
        -------
        sums : ndarray, shape ``(size, SUMS)``
            Column 0 is the mass, columns 1 and 2 the momentum ``sum_a S_ia m_a q_a``.
        velocity : ndarray, shape ``(size, 2)``
            Valid ``REACH_CELLS`` away from nodes whose sums are not whole.

        Raises
        ------
        BackendError
            An atom touches a node that is none of the patch's.
        """
        sums = np.zeros((self.size, SUMS))
        stray = _assemble(part, bits, m, x, q, back, *self._frame, sums.reshape(-1))
        if stray >= 0:
            raise _left(x[stray])
        complete(sums)
        if self._images.size:
            np.add.at(sums, self._imaged, sums[self._images])
            sums[self._images] = 0.0
        velocity = np.zeros((self.size, 2))
        rest = np.zeros((self.size, 2))
        steps = step_sizes(iterations)
        _solve(sums, self._columns, self._images, self._imaged, steps, velocity, rest)
        return sums, velocity

    def follow(self, part: Ints, bits: int, x: Floats, field: Floats, v: Floats) -> bool:
        """Set the velocity of the atoms that have one of the bits to ``sum_i S_ia V_i``.

        Parameters
        ----------
        part, bits, x
            As for ``project``.
        field : ndarray, shape ``(size, 2)``
            Nodal velocities, NaN where they are unknown.
        v : ndarray, shape ``(n, 2)``
            Changed in place.

        Returns
        -------
        bool
            Whether all nodal velocities that mattered were known.

        Raises
        ------
        BackendError
            An atom touches a node that is none of the patch's.
        """
        stray, known = _follow(part, bits, x, *self._frame, field, v)
        if stray >= 0:
            raise _left(x[stray])
        return bool(known)

    @property
    def _frame(self) -> tuple[object, ...]:
        """How kernels find the stencil of an atom."""
        return (
            self._origin,
            self._cell,
            self._half_width,
            self._period,
            self._low,
            self._first,
            self._known,
        )


def _window(
    grid: BackgroundGrid, axis: int, side: tuple[float, float], reach: float
) -> tuple[Ints, float]:
    """Node indices along an axis, and from where on (in cells) atoms are shifted to be in them."""
    cells = grid.cells[axis]
    low, high = ((edge - grid.origin[axis]) / grid.cell for edge in side)
    # a small allowance for the round-off of edges that fall on nodes
    first, last = int(np.ceil(low - reach - 1e-6)), int(np.floor(high + reach + 1e-6))
    if not grid.periodic[axis]:
        return np.arange(max(first, -PAD), min(last, cells + PAD) + 1), 0.0
    if last - first + 1 >= cells:
        return np.arange(-PAD, cells + PAD + 1), 0.0
    return np.arange(first, last + 1), 0.5 * (low + high - cells)


def _is_image(grid: BackgroundGrid, axes: list[tuple[Ints, float]]) -> np.ndarray:
    """Which nodes of the window, rim included, lie beyond the first period of a whole axis."""
    beyond = []
    for axis, (indices, low) in enumerate(axes):
        whole = (
            grid.periodic[axis] and low == 0.0 and indices.size == grid.cells[axis] + 1 + 2 * PAD
        )
        outside = (indices < 0) | (indices >= grid.cells[axis])
        beyond.append(np.pad(outside & whole, _RIM))
    return (beyond[0][:, None] | beyond[1][None, :]).ravel()


def _left(x: Floats) -> BackendError:
    return BackendError(
        f"an atom at ({x[0]:g}, {x[1]:g}) has left the background grid or "
        "lies too far outside its patch: the body has moved too far, the run is unstable "
        "(see the temperature in log.lammps), or the LAMMPS script changes the processor "
        "grid (processors, balance)"
    )


@njit(inline="always")
def _stencil(x, y, origin, cell, half_width, period, low, first, known):  # type: ignore[no-untyped-def]
    """First node in the window (row, column; -1 for a stray) and weights along both axes."""
    cx, cy = (x - origin[0]) / cell, (y - origin[1]) / cell
    if period[0] > 0.0:
        cx -= period[0] * np.floor((cx - low[0]) / period[0])
    if period[1] > 0.0:
        cy -= period[1] * np.floor((cy - low[1]) / period[1])
    i, sx0, sx1, sx2, _, _, _ = stencil(cx, half_width)
    j, sy0, sy1, sy2, _, _, _ = stencil(cy, half_width)
    i -= first[0]
    j -= first[1]
    if not (0 <= i < known.shape[0] - 2 and 0 <= j < known.shape[1] - 2) or not (
        known[i, j] and known[i, j + 2] and known[i + 2, j] and known[i + 2, j + 2]
    ):
        i = -1
    return i, j, (sx0, sx1, sx2), (sy0, sy1, sy2)


@njit(cache=True)
def _assemble(  # type: ignore[no-untyped-def]
    part, bits, m, x, q, back, origin, cell, half_width, period, low, first, known, sums
):
    """Add the atoms' mass, momentum and mass matrix; the index of a stray, or -1."""
    columns = known.shape[1]
    for a in range(part.shape[0]):
        if not part[a] & bits:
            continue
        qx, qy = q[a, 0], q[a, 1]
        i, j, sx, sy = _stencil(
            x[a, 0] - back * qx,
            x[a, 1] - back * qy,
            origin, cell, half_width, period, low, first, known,
        )  # fmt: skip
        if i < 0:
            return a
        sy0, sy1, sy2 = sy
        for k in range(3):
            node = SUMS * ((i + k) * columns + j)
            wx = m[a] * sx[k]
            for n in range(3):
                at = node + SUMS * n
                w = wx * sy[n]
                sums[at] += w
                sums[at + 1] += w * qx
                sums[at + 2] += w * qy
                at += _ROW + 2 - n
                for d in range(3 - k):
                    c = w * sx[k + d]
                    sums[at] += c * sy0
                    sums[at + 1] += c * sy1
                    sums[at + 2] += c * sy2
                    at += 5
    return -1


@njit(cache=True)
def _solve(sums, columns, images, imaged, steps, velocity, rest):  # type: ignore[no-untyped-def]
    """Lumped velocity, then its corrections ``V += step M^-1 (P - C V)``."""
    size = sums.shape[0]
    for i in range(size):
        if sums[i, 0] > 0.0:
            velocity[i, 0] = sums[i, 1] / sums[i, 0]
            velocity[i, 1] = sums[i, 2] / sums[i, 0]
    for step in steps:
        for k in range(images.size):
            velocity[images[k]] = velocity[imaged[k]]
        rest[:] = 0.0
        for i in range(size):
            if sums[i, 0] <= 0.0:
                continue
            rx, ry = sums[i, 1], sums[i, 2]
            vx, vy = velocity[i, 0], velocity[i, 1]
            for n in range(5):
                j = i + n - 2
                c = sums[i, _ROW + n]
                rx -= c * velocity[j, 0]
                ry -= c * velocity[j, 1]
            for d in range(1, 3):
                for n in range(5):
                    j = i + d * columns + n - 2
                    c = sums[i, _ROW + 5 * d + n]
                    rx -= c * velocity[j, 0]
                    ry -= c * velocity[j, 1]
                    rest[j, 0] -= c * vx
                    rest[j, 1] -= c * vy
            rest[i, 0] += rx
            rest[i, 1] += ry
        for k in range(images.size):
            rest[imaged[k]] += rest[images[k]]
        for i in range(size):
            if sums[i, 0] > 0.0:
                velocity[i, 0] += step * rest[i, 0] / sums[i, 0]
                velocity[i, 1] += step * rest[i, 1] / sums[i, 0]
    for k in range(images.size):
        velocity[images[k]] = velocity[imaged[k]]


@njit(cache=True)
def _follow(  # type: ignore[no-untyped-def]
    part, bits, x, origin, cell, half_width, period, low, first, known, field, v
):
    """Interpolate; the index of a stray or -1, and whether all values were finite."""
    columns, finite = known.shape[1], True
    for a in range(part.shape[0]):
        if not part[a] & bits:
            continue
        i, j, sx, sy = _stencil(
            x[a, 0], x[a, 1], origin, cell, half_width, period, low, first, known
        )
        if i < 0:
            return a, finite
        vx, vy = 0.0, 0.0
        for k in range(3):
            node = (i + k) * columns + j
            for n in range(3):
                s = sx[k] * sy[n]
                vx += s * field[node + n, 0]
                vy += s * field[node + n, 1]
        finite &= np.isfinite(vx) and np.isfinite(vy)
        v[a, 0], v[a, 1] = vx, vy
    return -1, finite

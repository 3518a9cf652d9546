"""Smooth motion of particles: a fit by cubic B-splines, and what it leaves over.

Particles are atoms at their lattice positions, and nodes. With masses m and splines N the fit has
at each spline the value

    W v = at the spline, the linear function fitted to the particles in reach with weights N m,

and what ``n`` corrections leave of velocities is ``R v = (1 - N W)^n v``. A linear field is its
own fit, so R takes it to zero. The transpose turns forces ``f`` on such a rest into forces on
particles, ``R^T f``, which have no resultant and no moment.

Two families of splines, the second moved by half a spacing, make the result independent of where
splines lie: R is the product of the two.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from gimpmd_md.coupling import spline_kernels
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.grid.background import BackgroundGrid

SPACING = 1.7
"""Spacing of the splines of a family, in cells. One cell less or more moves the edge between waves
that are taken and waves that are left: from 8 cells on waves must be left."""

CORRECTIONS = 3
"""How often each family removes what it fits; six in all."""

LEAST_MASS = 0.2
"""Least mass in reach of a spline, as a share of the largest. A spline with less extrapolates the
function of the nearest spline that has enough, or the mean of several as near. Shares of .02 to .3
do equally well."""

Reduce = Callable[[Floats], Floats]
"""Sums an array over all ranks."""


@dataclass(frozen=True)
class Lattice:
    """Where the splines of a family lie.

    Attributes
    ----------
    origin, spacing : ndarray, shape ``(d,)``
        Of spline 0, and between splines.
    counts : tuple of int
        Splines along each axis.
    periodic : tuple of bool
    """

    origin: Floats
    spacing: Floats
    counts: tuple[int, ...]
    periodic: tuple[bool, ...]

    @classmethod
    def over(cls, grid: BackgroundGrid, shift: float) -> Lattice:
        """Splines over the whole domain, moved by a part of their spacing."""
        spacing, counts = [], []
        for cells, periodic in zip(grid.cells, grid.periodic, strict=True):
            n = cells / SPACING
            whole = max(1, round(n))
            spacing.append(grid.cell * (cells / whole if periodic else SPACING))
            # three more at both ends: particles there touch two, and the family may be moved by one
            counts.append(whole if periodic else int(np.ceil(n)) + 6)
        first = [0.0 if periodic else -3.0 for periodic in grid.periodic]
        step = np.array(spacing)
        origin = np.array(grid.origin) + (np.array(first) + shift) * step
        return cls(origin, step, tuple(counts), grid.periodic)

    def touched(self, x: Floats) -> tuple[Ints, Floats, Floats]:
        """Block of the ``4^d`` splines of each position, place in the cell, and weights."""
        low, place, w = spline_kernels.weights((x - self.origin) / self.spacing)
        axes = []
        for axis, (count, periodic) in enumerate(zip(self.counts, self.periodic, strict=True)):
            index = low[:, axis, None] + np.arange(4)
            axes.append(index % count if periodic else index)
        block = axes[0]
        for count, index in zip(self.counts[1:], axes[1:], strict=True):
            block = (block[:, :, None] * count + index[:, None, :]).reshape(len(x), -1)
        return block, place, w


@dataclass(frozen=True)
class Sorted:
    """Particles of a rank in the order of the cells of a family; see `spline_kernels.sums`."""

    order: Ints
    start: Ints
    block: Ints
    place: Floats
    weights: Floats

    @classmethod
    def of(cls, lattice: Lattice, row: Ints, x: Floats) -> Sorted:
        """Sort particles at positions ``x``; ``row`` gives the rows of the splines."""
        block, place, w = lattice.touched(x)
        order = np.argsort(block[:, 0], kind="stable")
        block = block[order]
        first = np.flatnonzero(np.diff(block[:, 0], prepend=-1))
        start = np.append(first, len(x)).astype(np.int64)
        return cls(order, start, row[block[first]], place[order], w[order])

    def sums(self, values: Floats, splines: int, terms: int) -> Floats:
        """Sums of ``values (n, k)`` at the splines, shape ``(splines, terms, k)``."""
        out = np.zeros((splines, terms, values.shape[1]))
        spline_kernels.sums(
            self.order, self.start, self.block, self.place, self.weights, values, terms, out
        )
        return out

    def interpolate(self, field: Floats) -> Floats:
        """Values ``(n, k)`` at the particles of a field ``(splines, terms, k)``."""
        out = np.empty((len(self.order), field.shape[2]))
        spline_kernels.interpolate(
            self.order, self.start, self.block, self.place, self.weights, field, out
        )
        return out


class Family:
    """The splines of one lattice that particles touch, and their fit.

    Parameters
    ----------
    lattice : Lattice
    x, mass : ndarray, shapes ``(n, d)`` and ``(n,)``
        Of the particles of all ranks.
    """

    def __init__(self, lattice: Lattice, x: Floats, mass: Floats) -> None:
        self._lattice = lattice
        self._row = np.full(int(np.prod(lattice.counts)), -1, dtype=np.int64)
        touched = np.unique(lattice.touched(x)[0])
        self._row[touched] = np.arange(touched.size)
        self._size, self._terms = touched.size, x.shape[1] + 1
        second, products = _moments(self.sort(x), mass, self._size)
        place = np.stack(np.unravel_index(touched, lattice.counts), axis=1)
        self._value = _values(second, place.astype(float))
        self._round = (self._value @ products).tocsr()  # W N
        self._value_back, self._round_back = self._value.T.tocsr(), self._round.T.tocsr()

    def sort(self, x: Floats) -> Sorted:
        """Sort particles of a rank, all of them among those of the constructor."""
        return Sorted.of(self._lattice, self._row, x)

    def rest(self, cells: Sorted, mass: Floats, v: Floats, reduce: Reduce) -> Floats:
        """What the fit leaves of velocities ``v (n, d)``; ``mass (n, 1)``."""
        moments = reduce(cells.sums(mass * v, self._size, self._terms))
        fit = _corrected(self._round, self._value @ moments.reshape(-1, v.shape[1]))
        return v - cells.interpolate(fit[:, None])

    def spread(self, cells: Sorted, mass: Floats, f: Floats, reduce: Reduce) -> Floats:
        """The transpose of `rest`, for forces ``f (n, d)``."""
        sums = reduce(cells.sums(f, self._size, 1))
        back = self._value_back @ _corrected(self._round_back, sums[:, 0])
        return f - mass * cells.interpolate(back.reshape(self._size, self._terms, -1))


class SplineFit:
    """What both families leave of the motion of particles.

    Parameters
    ----------
    grid : BackgroundGrid
    x, mass : ndarray, shapes ``(n, d)`` and ``(n,)``
        Of the particles of all ranks, the same on all of them.
    comm : mpi4py communicator
    """

    def __init__(self, grid: BackgroundGrid, x: Floats, mass: Floats, comm: Any) -> None:
        self._families = [Family(Lattice.over(grid, shift), x, mass) for shift in (0.0, 0.5)]
        self._comm = comm

    def take(self, x: Floats, mass: Floats) -> None:
        """Take the particles of this rank, all of them among those of the constructor."""
        self._cells = [family.sort(x) for family in self._families]
        self._mass = mass[:, None]

    def rest(self, v: Floats) -> Floats:
        """``R v`` of velocities ``(n, d)`` of the particles taken; collective."""
        for family, cells in zip(self._families, self._cells, strict=True):
            v = family.rest(cells, self._mass, v, self._reduce)
        return v

    def spread(self, f: Floats) -> Floats:
        """``R^T f`` of forces ``(n, d)`` on the particles taken; collective."""
        for family, cells in zip(self._families[::-1], self._cells[::-1], strict=True):
            f = family.spread(cells, self._mass, f, self._reduce)
        return f

    def _reduce(self, part: Floats) -> Floats:
        if self._comm.size == 1:
            return part
        total = np.empty_like(part)
        self._comm.Allreduce(part, total)
        return total


def _corrected(once: sparse.csr_array, fit: Floats) -> Floats:
    """``sum_{k < n} (1 - W N)^k`` of a fit: the sum of n fits, each of what is left over."""
    total = fit
    for _ in range(CORRECTIONS - 1):
        fit = fit - once @ fit
        total = total + fit
    return total


def _moments(cells: Sorted, mass: Floats, size: int) -> tuple[Floats, sparse.csr_array]:
    """Second moments of the mass around the splines, and moments of splines times splines.

    Returns
    -------
    second : ndarray, shape ``(size, d + 1, d + 1)``
        ``sum_a N_ja m_a (1, r)(1, r)^T``, r the position relative to spline j.
    products : sparse, shape ``(size (d + 1), size)``
        ``sum_a N_ja m_a (1, r) N_la``.
    """
    d = cells.place.shape[1]
    terms, span = d + 1, 4**d
    shift = np.tile(np.eye(terms), (span, 1, 1))  # (1, r) from (1, place in the cell)
    shift[:, 1:, 0] = 1.5 - np.array(list(product(range(4), repeat=d)))
    second, products = np.zeros((size, terms, terms)), sparse.csr_array((size * terms, size))
    m, parts = mass[cells.order], list[tuple[Floats, Ints, Ints]]()
    for cell, block in enumerate(cells.block):
        of_cell = slice(cells.start[cell], cells.start[cell + 1])
        N = cells.weights[of_cell, 0]
        for axis in range(1, d):
            N = (N[:, :, None] * cells.weights[of_cell, axis, None, :]).reshape(len(N), -1)
        linear = np.concatenate([np.ones((len(N), 1)), cells.place[of_cell]], axis=1)
        first = ((N * m[of_cell, None])[:, :, None] * linear[:, None, :]).reshape(len(N), -1)
        local = (first.T @ linear).reshape(span, terms, terms)
        # a periodic axis of few splines has some of them in the block twice
        np.add.at(second, block, shift @ local @ shift.transpose(0, 2, 1))
        mixed = shift @ (first.T @ N).reshape(span, terms, span)
        rows = np.broadcast_to((block[:, None] * terms + np.arange(terms))[:, :, None], mixed.shape)
        columns = np.broadcast_to(block, mixed.shape)
        parts.append((mixed.ravel(), rows.ravel(), columns.ravel()))
        if len(parts) == _AT_ONCE or cell == len(cells.block) - 1:
            value, i, j = (np.concatenate(each) for each in zip(*parts, strict=True))
            products = products + sparse.coo_array((value, (i, j)), products.shape).tocsr()
            parts.clear()
    return second, products


_AT_ONCE = 256
"""Cells whose products of splines are added at once: 50 MB of them in three dimensions."""


def _values(second: Floats, place: Floats) -> sparse.csr_array:
    """Values at the splines by moments of velocities, shape ``(size, size (d + 1))``.

    Parameters
    ----------
    second : see `_moments`.
    place : ndarray, shape ``(size, d)``
        Of the splines, in spacings.
    """
    size, terms, _ = second.shape
    mass = second[:, 0, 0]
    enough = np.flatnonzero(mass >= LEAST_MASS * mass.max())
    most = min(_MOST_NEAREST, enough.size)
    distance, near = cKDTree(place[enough]).query(place, k=range(1, most + 1))
    j, among = np.nonzero(distance <= distance[:, :1] * (1.0 + 1e-9))
    source = enough[near[j, among]]
    linear = np.concatenate([np.ones((j.size, 1)), place[j] - place[source]], axis=1)
    value = np.linalg.solve(second[source], linear[:, :, None])[:, :, 0]
    value /= np.bincount(j)[j, None]
    columns = source[:, None] * terms + np.arange(terms)
    rows = np.broadcast_to(j[:, None], columns.shape)
    entries = (value.ravel(), (rows.ravel(), columns.ravel()))
    return sparse.coo_array(entries, (size, size * terms)).tocsr()


_MOST_NEAREST = 12
"""Splines at the same distance whose functions are averaged, at most."""

"""Atoms and nodes of the force scheme: linear hats at lattice positions, fixed for a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.background import PAD, BackgroundGrid

NEXT_TO_NODE = 2e-6
"""Distance, in cells, at which an atom counts as on a node line; the node beyond has no share."""


@dataclass(frozen=True)
class Stencils:
    """Which nodes some atoms touch: rows ``(n, 4)`` in nodal fields, and the weights there."""

    rows: Ints
    weights: Floats

    def gather(self, values: Floats, nodes: int) -> Floats:
        """Nodal sums ``sum_a S_ia values_a``, shape ``(nodes, 2)``, of ``values`` ``(n, 2)``."""
        sums = np.zeros((nodes, 2))
        _gather(self.rows, self.weights, values, sums)
        return sums

    def interpolate(self, field: Floats) -> Floats:
        """Values at the atoms ``sum_i S_ia field_i``, shape ``(n, 2)``."""
        out = np.empty((len(self.rows), 2))
        _interpolate(self.rows, self.weights, field, out)
        return out


class Hats:
    """Bilinear hat functions of a set of nodes.

    Parameters
    ----------
    grid : BackgroundGrid
    nodes : ndarray of int64
        Ids of canonical nodes: rows of all fields, in this order.
    """

    def __init__(self, grid: BackgroundGrid, nodes: Ints) -> None:
        row = np.full(grid.size, -1, dtype=np.int64)
        row[nodes] = np.arange(nodes.size)
        self._row = row
        self._rows = np.ascontiguousarray(row[grid.images()].reshape(grid.shape))
        self._origin, self._cell = np.array(grid.origin), grid.cell

    def rows(self, nodes: Ints) -> Ints:
        """Rows of nodes, by id, in nodal fields."""
        return np.asarray(self._row[nodes], dtype=np.int64)

    def stencils(self, x: Floats) -> Stencils:
        """Stencils of atoms at lattice positions ``x``, shape ``(n, 2)``, inside the domain.

        Raises
        ------
        BackendError
            An atom touches a node that is not of the set.
        """
        stray, rows, weights = _stencils(x, self._origin, self._cell, self._rows)
        if stray >= 0:
            raise _lost(x[stray])
        return Stencils(rows, weights)

    def marked(self, part: Ints, bit: int, x: Floats) -> tuple[Ints, Stencils]:
        """Places of the atoms that have a bit, and their stencils; see ``stencils``.

        Parameters
        ----------
        part : ndarray of int32, shape ``(n,)``
        bit : int
        x : ndarray, shape ``(n, 2)``
            Lattice positions of all atoms.
        """
        # in one go: right after a window of LAMMPS all memory is far away
        places, stray, rows, weights = _marked(part, bit, x, self._origin, self._cell, self._rows)
        if stray >= 0:
            raise _lost(x[places[stray]])
        return places, Stencils(rows, weights)


def _lost(x: Floats) -> BackendError:
    return BackendError(
        f"the atom of lattice position ({x[0]:g}, {x[1]:g}) is on a rank whose patch lies too far "
        "away: the body has moved or stretched by several cells, the run is unstable (see the "
        "temperature in log.lammps), or the LAMMPS script changes the processor grid (processors, "
        "balance); fewer md.patches leave more room"
    )


@njit(inline="always")
def _place(x: float, origin: float, cell: float) -> tuple[int, float]:
    """Node below, as an index of the padded grid, and the share of the node above."""
    c = (x - origin) / cell
    i = np.floor(c + NEXT_TO_NODE)
    share = c - i
    return int(i) + PAD, 0.0 if share < NEXT_TO_NODE else share


@njit(cache=True)
def _stencil(  # type: ignore[no-untyped-def]
    x, origin, cell, known, rows, weights
):
    """Fill rows and weights of one atom; whether it touches a node that is not known."""
    i, sx = _place(x[0], origin[0], cell)
    j, sy = _place(x[1], origin[1], cell)
    stray = False
    for k in range(2):
        for n in range(2):
            w = (sx if k else 1.0 - sx) * (sy if n else 1.0 - sy)
            row = known[i + k, j + n]
            stray |= row < 0 and w > 0.0
            # without a share any row will do: it gets nothing
            rows[2 * k + n], weights[2 * k + n] = max(row, 0), w
    return stray


@njit(cache=True)
def _stencils(x, origin, cell, known):  # type: ignore[no-untyped-def]
    """Index of a stray, or -1; rows and weights of all atoms."""
    rows, weights, stray = np.empty((len(x), 4), np.int64), np.empty((len(x), 4)), -1
    for a in range(len(x)):
        if _stencil(x[a], origin, cell, known, rows[a], weights[a]):
            stray = a
    return stray, rows, weights


@njit(cache=True)
def _marked(part, bit, x, origin, cell, known):  # type: ignore[no-untyped-def]
    """Places of the atoms that have a bit, then as ``_stencils`` of them."""
    places = np.flatnonzero(part & bit)
    stray, rows, weights = _stencils(x[places], origin, cell, known)
    return places, stray, rows, weights


@njit(cache=True)
def _gather(rows: Ints, weights: Floats, values: Floats, sums: Floats) -> None:
    for a in range(rows.shape[0]):
        vx, vy = values[a, 0], values[a, 1]
        for k in range(4):
            sums[rows[a, k], 0] += weights[a, k] * vx
            sums[rows[a, k], 1] += weights[a, k] * vy


@njit(cache=True)
def _interpolate(rows: Ints, weights: Floats, field: Floats, out: Floats) -> None:
    for a in range(rows.shape[0]):
        vx, vy = 0.0, 0.0
        for k in range(4):
            vx += weights[a, k] * field[rows[a, k], 0]
            vy += weights[a, k] * field[rows[a, k], 1]
        out[a, 0], out[a, 1] = vx, vy

"""Ghost atoms and nodes: linear hat functions at the atoms' lattice positions, fixed for a run."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid import PAD, BackgroundGrid, Floats, Ints

NEXT_TO_NODE = 2e-6
"""Distance, in cells, at which an atom counts as on a node line; the node beyond has no share."""


class Hats:
    """Bilinear interpolation on a set of nodes, and its transpose.

    Parameters
    ----------
    grid : BackgroundGrid
    nodes : ndarray of int64
        Ids of canonical nodes: rows of all fields, in this order.
    """

    def __init__(self, grid: BackgroundGrid, nodes: Ints) -> None:
        row = np.full(grid.size, -1, dtype=np.int64)
        row[nodes] = np.arange(nodes.size)
        self._rows = np.ascontiguousarray(row[grid.images()].reshape(grid.shape))
        self._origin, self._cell = np.array(grid.origin), grid.cell

    def gather(self, part: Ints, bits: int, x: Floats, f: Floats, sums: Floats) -> None:
        """Add ``sum_a S_ia f_a`` over the atoms that have one of the bits.

        Parameters
        ----------
        part : ndarray of int, shape ``(n,)``
        bits : int
        x : ndarray, shape ``(n, 2)``
            Lattice positions inside the domain.
        f : ndarray, shape ``(n, 2)``
        sums : ndarray, shape ``(nodes, 2)``
            Changed in place.

        Raises
        ------
        BackendError
            An atom touches a node that is not of the set.
        """
        _check(_gather(part, bits, x, self._origin, self._cell, self._rows, f, sums), x)

    def interpolate(self, part: Ints, bits: int, x: Floats, field: Floats, out: Floats) -> None:
        """Set ``out_a = sum_i S_ia field_i`` of the atoms that have one of the bits.

        Parameters
        ----------
        part, bits, x
            As for ``gather``.
        field : ndarray, shape ``(nodes, 2)``
        out : ndarray, shape ``(n, 2)``
            Changed in place.

        Raises
        ------
        BackendError
            An atom touches a node that is not of the set.
        """
        _check(_interpolate(part, bits, x, self._origin, self._cell, self._rows, field, out), x)


def _check(stray: int, x: Floats) -> None:
    if stray >= 0:
        raise BackendError(
            f"the ghost atom of lattice position ({x[stray, 0]:g}, {x[stray, 1]:g}) is on a rank "
            "whose patch lies too far away: the body has moved or stretched by several cells, the "
            "run is unstable (see the temperature in log.lammps), or the LAMMPS script changes the "
            "processor grid (processors, balance); fewer md.patches leave more room"
        )


@njit(inline="always")
def _place(x: float, origin: float, cell: float) -> tuple[int, float]:
    """Node below, as an index of the padded grid, and the share of the node above."""
    c = (x - origin) / cell
    i = np.floor(c + NEXT_TO_NODE)
    share = c - i
    return int(i) + PAD, 0.0 if share < NEXT_TO_NODE else share


@njit(cache=True)
def _gather(  # type: ignore[no-untyped-def]
    part: Any, bits, x, origin, cell, rows, f, sums
):
    """Add the atoms' shares; the index of a stray, or -1."""
    for a in range(part.shape[0]):
        if not part[a] & bits:
            continue
        i, sx = _place(x[a, 0], origin[0], cell)
        j, sy = _place(x[a, 1], origin[1], cell)
        for k in range(2):
            wx = sx if k else 1.0 - sx
            for n in range(2):
                w = wx * (sy if n else 1.0 - sy)
                if w == 0.0:
                    continue
                row = rows[i + k, j + n]
                if row < 0:
                    return a
                sums[row, 0] += w * f[a, 0]
                sums[row, 1] += w * f[a, 1]
    return -1


@njit(cache=True)
def _interpolate(  # type: ignore[no-untyped-def]
    part: Any, bits, x, origin, cell, rows, field, out
):
    """Interpolate; the index of a stray, or -1."""
    for a in range(part.shape[0]):
        if not part[a] & bits:
            continue
        i, sx = _place(x[a, 0], origin[0], cell)
        j, sy = _place(x[a, 1], origin[1], cell)
        vx, vy = 0.0, 0.0
        for k in range(2):
            wx = sx if k else 1.0 - sx
            for n in range(2):
                w = wx * (sy if n else 1.0 - sy)
                if w == 0.0:
                    continue
                row = rows[i + k, j + n]
                if row < 0:
                    return a
                vx += w * field[row, 0]
                vy += w * field[row, 1]
        out[a, 0], out[a, 1] = vx, vy
    return -1

"""Atoms and nodes of schemes with planes: hat functions at lattice positions, which stay fixed.

In the force scheme the weights of an atom are those of the linear hat functions at its lattice
position. In the sites scheme they are averaged over one period of the crystal around it: the
atom has the weights of a material point of this size.

An atom keeps its lattice position during a run, so its nodes and weights never change.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.particle_grid import (
    gimp_stencil,
    grid_to_particles,
    linear_stencil,
    particles_to_grid,
    window_of,
)
from gimpmd_schemas.grid.planes import NO_WEIGHT

ON_NODE = 2e-6
"""An atom closer than this to a line of nodes (in cells) is on the line.

Lattice positions are known to round-off only. An atom on a line of nodes has no weight on the
nodes beyond it, which the patch may not hold.
"""


@dataclass(frozen=True)
class Stencils:
    """Nodes that some atoms touch, and their weights.

    Attributes
    ----------
    rows : ndarray of int64, shape ``(n, m)``
        Rows of the nodes in nodal fields; m is 2^d, or 3^d with averaged weights.
    weights : ndarray, shape ``(n, m)``
    """

    rows: Ints
    weights: Floats

    def gather(self, values: Floats, nodes: int) -> Floats:
        """Sum values ``(n, k)`` of the atoms at the nodes, ``sum_a S_ia values_a``.

        Returns
        -------
        ndarray, shape ``(nodes, k)``
        """
        sums = np.zeros((nodes, values.shape[1]))
        particles_to_grid(self.rows, self.weights, values, sums)
        return sums

    def interpolate(self, field: Floats) -> Floats:
        """Interpolate a nodal field ``(nodes, k)`` to the atoms, ``sum_i S_ia field_i``."""
        out = np.empty((len(self.rows), field.shape[1]))
        grid_to_particles(self.rows, self.weights, field, out)
        return out


class ShapeFunctions:
    """Hat functions of a set of nodes.

    Parameters
    ----------
    grid : BackgroundGrid
    nodes : ndarray of int64
        Ids of canonical nodes. Nodal fields have one row for each of them, in this order.
    half : ndarray, shape ``(d,)``, optional
        Half-widths, in cells, over which the hat functions are averaged; None: not at all.
    """

    def __init__(self, grid: BackgroundGrid, nodes: Ints, half: Floats | None = None) -> None:
        self._half = np.empty(0) if half is None else half
        self._row = np.full(grid.size, -1, dtype=np.int64)
        self._row[nodes] = np.arange(nodes.size)
        self._origin, self._cell = grid.origin, grid.cell
        # the images of nodes have rows too, which is faster than finding the nodes they repeat
        self._window = window_of(grid)._replace(period=(0,) * grid.dim)
        self._row_of_image = self._row[grid.images()]

    def marked(self, role: Ints, bit: int, x: Floats) -> tuple[Ints, Stencils, int]:
        """Find the atoms that have a bit, and their stencils.

        Parameters
        ----------
        role : ndarray of int32, shape ``(n,)``
        bit : int
        x : ndarray, shape ``(n, d)``
            Lattice positions of all atoms, inside the domain.

        Returns
        -------
        rows : ndarray of int64
            Indices of the atoms.
        stencils : Stencils
        stray : int
            Index of an atom that touches a node that is not in the set, or -1. If there is one, the
            stencils are of no use.
        """
        # one compiled call: right after LAMMPS has run, none of this memory is in the caches
        places, stray, rows, weights = _marked(
            role, bit, x, self._origin, self._cell, self._window, self._row_of_image, self._half
        )
        return places, Stencils(rows, weights), int(places[stray]) if stray >= 0 else -1


@njit(cache=True)
def _stencils(x, origin, cell, window, row, half):  # type: ignore[no-untyped-def]
    """Index of an atom that touches an unknown node, or -1; rows and weights of all atoms."""
    d, averaged = len(origin), len(half) > 0
    count = 3**d if averaged else 2**d
    rows, weights = np.empty((len(x), count), np.int64), np.empty((len(x), count))
    t, stray = np.empty(d), -1
    for a in range(len(x)):
        for axis in range(d):
            t[axis] = _snapped((x[a, axis] - origin[axis]) / cell)
        if averaged:
            gimp_stencil(t, half, window, rows[a], weights[a])
        else:
            linear_stencil(t, window, rows[a], weights[a])
        for i in range(count):
            if averaged and weights[a, i] < NO_WEIGHT:
                weights[a, i] = 0.0
            known = row[rows[a, i]]
            if known < 0 and weights[a, i] > 0.0:
                stray = a
            rows[a, i] = max(known, 0)  # any row will do where the weight is zero
    return stray, rows, weights


@njit(inline="always")
def _snapped(t: float) -> float:
    """Move a coordinate that is next to a node onto it."""
    nearest = np.rint(t)
    return nearest if abs(t - nearest) < ON_NODE else t


@njit(cache=True)
def _marked(role, bit, x, origin, cell, window, row, half):  # type: ignore[no-untyped-def]
    """Indices of the atoms that have a bit, and the results of ``_stencils`` for them."""
    places = np.flatnonzero(role & bit)
    stray, rows, weights = _stencils(x[places], origin, cell, window, row, half)
    return places, stray, rows, weights

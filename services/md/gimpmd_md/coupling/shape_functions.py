"""Atoms and nodes of schemes with planes: hat functions at lattice positions, which stay fixed.

In the force scheme the weights of an atom are those of the linear hat functions at its lattice
position. In the sites scheme they are averaged over one period of the crystal around it: the
atom has the weights of a material point of this size.

In a crystal with a basis the atoms of a primitive cell move against each other too, by an inner
shift that is linear in the gradient of the nodal field (`crystal.inner_shift`). Forces on the atoms
go back by the transpose.

An atom keeps its lattice position during a run, so its nodes and weights never change.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from gimpmd_md.crystal.inner_shift import InnerShift, couples, shifts
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.compiled import njit
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.particle_grid import (
    gimp_stencil,
    gimp_stencils,
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
class Shifted:
    """Atoms with an inner shift.

    Attributes
    ----------
    atoms : ndarray of int64, shape ``(s,)``
        Their places among the atoms of the stencils.
    rows : ndarray of int64, shape ``(s, m)``
    slopes : ndarray, shape ``(d, s, m)``
        Gradients of the weights along each axis (1 / length).
    kappa : ndarray, shape ``(s, d, d, d)``
        Inner shift per displacement gradient (length).
    """

    atoms: Ints
    rows: Ints
    slopes: Floats
    kappa: Floats

    def gather(self, forces: Floats, sums: Floats) -> None:
        """Add what the forces ``(n, d)`` on all atoms do on the nodes ``(nodes, d)``."""
        acting = couples(self.kappa, forces[self.atoms])
        for axis, slope in enumerate(self.slopes):
            along = np.ascontiguousarray(acting[:, :, axis])
            particles_to_grid(self.rows, slope, along, sums)

    def interpolate(self, field: Floats, out: Floats) -> None:
        """Add the shifts, or their rates, to values ``(n, d)`` of all atoms."""
        gradient = np.empty((len(self.atoms), field.shape[1], len(self.slopes)))
        for axis, slope in enumerate(self.slopes):
            along = np.empty(gradient.shape[:2])
            grid_to_particles(self.rows, slope, field, along)
            gradient[:, :, axis] = along
        out[self.atoms] += shifts(self.kappa, gradient)

    def matrix(self, atoms: int, nodes: int) -> sparse.csr_array:
        """The shifts as a matrix; see `Stencils.matrix`."""
        count, dim = self.kappa.shape[:2]
        across = self.rows.shape[1]
        values = np.einsum("smij,jsa->smai", self.kappa, self.slopes)
        rows = self.atoms[:, None, None, None] * dim + np.arange(dim)[:, None, None]
        columns = self.rows[:, None, :, None] * dim + np.arange(dim)
        shape = (count, dim, across, dim)
        places = np.broadcast_to(rows, shape).ravel(), np.broadcast_to(columns, shape).ravel()
        return sparse.csr_array((values.ravel(), places), shape=(atoms * dim, nodes * dim))


@dataclass(frozen=True)
class Stencils:
    """Nodes that some atoms touch, and their weights.

    Attributes
    ----------
    rows : ndarray of int64, shape ``(n, m)``
        Rows of the nodes in nodal fields; m is 2^d, or 3^d with averaged weights.
    weights : ndarray, shape ``(n, m)``
    shifted : Shifted or None
        The atoms with an inner shift; None if inner shifts are left out. With them fields have d
        components.
    """

    rows: Ints
    weights: Floats
    shifted: Shifted | None = None

    def gather(self, values: Floats, nodes: int) -> Floats:
        """Sum values ``(n, k)`` of the atoms at the nodes: the transpose of `interpolate`.

        Returns
        -------
        ndarray, shape ``(nodes, k)``
        """
        sums = np.zeros((nodes, values.shape[1]))
        particles_to_grid(self.rows, self.weights, values, sums)
        if self.shifted is not None:
            self.shifted.gather(values, sums)
        return sums

    def interpolate(self, field: Floats) -> Floats:
        """Interpolate a nodal field ``(nodes, k)``: ``sum_i S_ia field_i``, and inner shifts."""
        out = np.empty((len(self.rows), field.shape[1]))
        grid_to_particles(self.rows, self.weights, field, out)
        if self.shifted is not None:
            self.shifted.interpolate(field, out)
        return out

    def matrix(self, nodes: int, dim: int) -> sparse.csr_array:
        """`interpolate` as a matrix, of fields with d components; shape ``(n d, nodes d)``."""
        count, across = self.rows.shape
        parts = self.weights.ravel(), self.rows.ravel(), across * np.arange(count + 1)
        weights = sparse.csr_array(parts, shape=(count, nodes), copy=True)
        weights.eliminate_zeros()
        matrix = sparse.kron(weights, sparse.eye_array(dim), format="csr")
        if self.shifted is not None:
            matrix = matrix + self.shifted.matrix(count, nodes)
        return sparse.csr_array(matrix)


class ShapeFunctions:
    """Hat functions of a set of nodes.

    Parameters
    ----------
    grid : BackgroundGrid
    nodes : ndarray of int64
        Ids of canonical nodes. Nodal fields have one row for each of them, in this order.
    half : ndarray, shape ``(d,)``, optional
        Half-widths, in cells, over which the hat functions are averaged; None: not at all.
    shift : InnerShift, optional
        Inner shifts of the crystal. They need averaged hat functions, which have smooth gradients.
    """

    def __init__(
        self,
        grid: BackgroundGrid,
        nodes: Ints,
        half: Floats | None = None,
        shift: InnerShift | None = None,
    ) -> None:
        self._half, self._shift = np.empty(0) if half is None else half, shift
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
        shifted = None if self._shift is None else self._shifted(self._shift, x[places])
        return places, Stencils(rows, weights, shifted), int(places[stray]) if stray >= 0 else -1

    def _shifted(self, shift: InnerShift, x: Floats) -> Shifted:
        """Find which of the atoms ``(n, d)`` have an inner shift; see `Shifted`."""
        kappa = shift.at(x)
        atoms = np.flatnonzero(kappa.any(axis=(1, 2, 3)))
        t = (x[atoms] - self._origin) / self._cell
        half = np.tile(self._half, (len(atoms), 1))
        nodes, _, slopes = gimp_stencils(t, half, self._cell, self._window)
        rows = self._row_of_image[nodes]
        slopes[rows < 0] = 0.0  # at these nodes the weights are zero up to round-off
        return Shifted(
            atoms,
            np.maximum(rows, 0),
            np.ascontiguousarray(np.moveaxis(slopes, 2, 0)),
            kappa[atoms],
        )


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

"""The background grid that both sides share: what "nodal velocity" refers to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimpmd_schemas.arrays import Bools, Floats, Ints

PAD = 2
"""Layers of nodes kept beyond the domain on every side, so that stencils need no branches."""


@dataclass(frozen=True)
class BackgroundGrid:
    """A uniform Eulerian grid over the domain, padded by ``PAD`` nodes.

    Node ``(i, j)`` lies at ``origin + cell * (i, j)``; ``i`` runs from ``-PAD`` to
    ``cells[0] + PAD``. The flat *node id* numbers the padded array in C order, so an id alone
    says where a node is; on the bus nodes are named by it. Two-dimensional, as the coupling is.

    Parameters
    ----------
    origin : tuple of float
        Lower corner of the domain (length units).
    cell : float
        Edge length h of a cell.
    cells : tuple of int
        Number of cells along each axis.
    periodic : tuple of bool
        Axes along which the domain repeats.
    """

    origin: tuple[float, float]
    cell: float
    cells: tuple[int, int]
    periodic: tuple[bool, bool]

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of the padded node arrays."""
        return (self.cells[0] + 1 + 2 * PAD, self.cells[1] + 1 + 2 * PAD)

    @property
    def size(self) -> int:
        """Number of nodes, padding included."""
        return self.shape[0] * self.shape[1]

    def positions(self) -> Floats:
        """Positions of all nodes, shape ``(size, 2)``, in the order of node ids."""
        axes = [self.origin[a] + self.cell * (np.arange(self.shape[a]) - PAD) for a in range(2)]
        x, y = np.meshgrid(*axes, indexing="ij")
        return np.stack([x.ravel(), y.ravel()], axis=1)

    def canonical(self) -> Bools:
        """Which nodes stand for themselves: all but periodic images, shape ``(size,)``."""
        keep = np.ones(self.shape, dtype=np.bool_)
        for axis in range(2):
            if self.periodic[axis]:
                index = np.arange(self.shape[axis]) - PAD
                inside = (index >= 0) & (index < self.cells[axis])
                keep &= inside[:, None] if axis == 0 else inside[None, :]
        return keep.ravel()

    def images(self) -> Ints:
        """For every node the id of the node it repeats (itself away from periodic faces)."""
        axes = []
        for axis in range(2):
            index = np.arange(self.shape[axis]) - PAD
            axes.append(index % self.cells[axis] + PAD if self.periodic[axis] else index + PAD)
        return (axes[0][:, None] * self.shape[1] + axes[1][None, :]).ravel().astype(np.int64)

    def fold(self, field: Floats) -> None:
        """Add what lies on periodic images to the nodes they repeat, and copy the sums back.

        Parameters
        ----------
        field : ndarray, shape ``(nx, ny, ...)``
            Nodal sums on the padded grid; changed in place.
        """
        for axis in range(2):
            if not self.periodic[axis]:
                continue
            lines = np.moveaxis(field, axis, 0)  # a view: writes reach the field
            n = self.cells[axis]
            target = (np.arange(n + 1 + 2 * PAD) - PAD) % n + PAD
            for index in np.flatnonzero(target != np.arange(target.size)):
                lines[target[index]] += lines[index]
            for index in np.flatnonzero(target != np.arange(target.size)):
                lines[index] = lines[target[index]]

"""The background grid that both sides share: the nodes that a "nodal velocity" belongs to."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import reduce

import numpy as np

from gimpmd_schemas.arrays import Bools, Floats, Ints

PAD = 2
"""Layers of nodes beyond the domain on every side, so that stencils need no branches there."""


@dataclass(frozen=True)
class BackgroundGrid:
    """A uniform Eulerian grid over the domain, padded by ``PAD`` nodes on every side.

    The node with indices ``(i, j)``, or ``(i, j, k)`` in three dimensions, lies at
    ``origin + cell * (i, j, k)``. The indices along axis ``a`` run from ``-PAD`` to
    ``cells[a] + PAD``. The *node id* numbers the nodes of the padded array in C order. An id
    therefore tells where its node is, and messages name nodes by their ids.

    Parameters
    ----------
    origin : tuple of float
        Lower corner of the domain (length units), one number for each of the d axes.
    cell : float
        Edge length h of a cell.
    cells : tuple of int
        Number of cells along each axis.
    periodic : tuple of bool
        Whether the domain repeats along each axis.
    """

    origin: tuple[float, ...]
    cell: float
    cells: tuple[int, ...]
    periodic: tuple[bool, ...]

    @property
    def dim(self) -> int:
        """Number of dimensions, 2 or 3."""
        return len(self.cells)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the padded node arrays."""
        return tuple(n + 1 + 2 * PAD for n in self.cells)

    @property
    def size(self) -> int:
        """Number of nodes, including the padding."""
        return math.prod(self.shape)

    @property
    def box(self) -> tuple[tuple[float, float], ...]:
        """Lower and upper end of the domain along each axis (length)."""
        return tuple(
            (low, low + n * self.cell) for low, n in zip(self.origin, self.cells, strict=True)
        )

    def positions(self) -> Floats:
        """Positions of all nodes, shape ``(size, d)``, in the order of their ids."""
        axes = [
            low + self.cell * (np.arange(n) - PAD)
            for low, n in zip(self.origin, self.shape, strict=True)
        ]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, self.dim)

    def canonical(self) -> Bools:
        """Tell which nodes are not the periodic image of another node; shape ``(size,)``."""
        keep = []
        for n, periodic in zip(self.cells, self.periodic, strict=True):
            index = np.arange(n + 1 + 2 * PAD) - PAD
            keep.append(((index >= 0) & (index < n)) | (not periodic))
        return np.asarray(reduce(np.logical_and.outer, keep).ravel(), dtype=np.bool_)

    def images(self) -> Ints:
        """Give the id of the canonical node that each node repeats; shape ``(size,)``.

        A canonical node repeats itself.
        """
        axes = []
        for n, periodic in zip(self.cells, self.periodic, strict=True):
            index = np.arange(n + 1 + 2 * PAD) - PAD
            axes.append((index % n if periodic else index) + PAD)
        return np.ravel_multi_index(np.ix_(*axes), self.shape).ravel().astype(np.int64)

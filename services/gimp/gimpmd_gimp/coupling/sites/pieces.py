"""Cells cut at the planes: every piece lies in one cell, and on one side of each plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from gimpmd_gimp.coupling.interface.weights import Sparse, gradients
from gimpmd_gimp.coupling.sites.shells import Shells, inside
from gimpmd_schemas.arrays import Bools, Floats
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.zones import Box

ROUNDING = 1e-9
"""Widths below this, in cells, are round-off."""

POINTS_PER_AXIS = 2
"""Pieces of a cell that no plane cuts, along each axis."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """Boxes that fill a grid.

    Attributes
    ----------
    x : ndarray, shape ``(n, d)``
        Middles (length).
    half : ndarray, shape ``(n, d)``
        Half-widths in cells.
    volume : ndarray, shape ``(n,)``
        Area or volume.
    free, active : ndarray of bool, shape ``(n,)``
        Whether a piece lies within plane 1, and within plane 2.
    """

    x: Floats
    half: Floats
    volume: Floats
    free: Bools
    active: Bools

    def take(self, chosen: Bools) -> Pieces:
        """Pieces chosen by a mask."""
        return Pieces(**{f.name: getattr(self, f.name)[chosen] for f in fields(self)})

    def share(self, boxes: Sequence[Box], cell: float) -> Floats:
        """Share of each piece that lies in one of some boxes, in the one that holds most of it."""
        most = np.zeros(len(self.x))
        low, high = self.x - cell * self.half, self.x + cell * self.half
        for box in boxes:
            start, end = np.array(box).T
            width = np.clip(np.minimum(high, end) - np.maximum(low, start), 0.0, None)
            most = np.maximum(most, np.prod(width / (high - low), axis=1))
        return most

    def slopes(self, grid: BackgroundGrid) -> tuple[Sparse, ...]:
        """Mean gradients of the hat functions in the pieces, exact; a matrix for each axis."""
        return gradients(grid, self.x, self.half)


def cut_cells(grid: BackgroundGrid, shells: Shells, around: float = np.inf) -> Pieces:
    """Cells of a grid, cut at the planes of the shells.

    Parameters
    ----------
    around : float
        Cells within this distance, in cells, of the box around all shells.
    """
    middles, halves = [], []
    for axis, count in enumerate(grid.cells):
        planes = (shells.lines(axis) - grid.origin[axis]) / grid.cell
        lines = np.concatenate([np.arange(POINTS_PER_AXIS * count + 1) / POINTS_PER_AXIS, planes])
        ends = np.array([box[axis] for box in shells.active])
        low = np.floor((ends.min() - grid.origin[axis]) / grid.cell - around)
        high = np.ceil((ends.max() - grid.origin[axis]) / grid.cell + around)
        lines = np.sort(lines[(lines >= max(low, 0.0)) & (lines <= min(high, count))])
        lines = lines[np.append(True, np.diff(lines) > ROUNDING)]
        middles.append(0.5 * (lines[1:] + lines[:-1]))
        halves.append(0.5 * np.diff(lines))
    x, half = (
        np.stack(np.meshgrid(*parts, indexing="ij"), axis=-1).reshape(-1, grid.dim)
        for parts in (middles, halves)
    )
    x = np.asarray(grid.origin) + grid.cell * x
    return Pieces(
        x=x,
        half=half,
        volume=np.prod(2.0 * half * grid.cell, axis=1),
        free=inside(shells.free, x),
        active=inside(shells.active, x),
    )

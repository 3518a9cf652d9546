"""Quadrature points on a face of the domain, over which tractions are summed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from gimpmd_gimp.coupling.interface.weights import Sparse, hats
from gimpmd_gimp.fem.elements import renumber
from gimpmd_gimp.points.material_points import MaterialPoints
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.grid.background import BackgroundGrid

ON_FACE = 1e-6
"""Distance from a face, in cells, that is rounding."""


@dataclass(frozen=True, eq=False)
class FacePoints:
    """Quadrature points.

    Attributes
    ----------
    x : ndarray, shape ``(n, d)``
    area : ndarray, shape ``(n,)``
        Weights of the points (lengths in two dimensions).
    values : sparse matrix, shape ``(n, nodes)``
        Shape functions at the points.
    """

    x: Floats
    area: Floats
    values: Sparse

    def renumbered(self, number: Ints, count: int) -> FacePoints:
        """The same points; node ``i`` becomes ``number[i]`` of ``count`` nodes."""
        return FacePoints(self.x, self.area, renumber(self.values, number, count))


def of_boxes(
    grid: BackgroundGrid, boxes: MaterialPoints, axis: int, side: int, place: float
) -> FacePoints:
    """Centres of the outer faces of boxes on the shared grid; its ids number the nodes.

    A shape function at such a centre is its mean over the face.

    Parameters
    ----------
    axis, side : int
        The face of the domain; side 0 is the lower one.
    place : float
        Its coordinate (length).
    """
    outer = boxes.reference[:, axis] + (2 * side - 1) * grid.cell * boxes.half[:, axis]
    chosen = np.abs(outer - place) < ON_FACE * grid.cell
    x, half = boxes.reference[chosen], np.delete(boxes.half[chosen], axis, axis=1)
    x[:, axis] = place
    area = (2.0 * grid.cell * half).prod(axis=1)
    return FacePoints(x, area, hats(grid, x))


def join(parts: Sequence[FacePoints]) -> FacePoints:
    """All points, one part after the other."""
    return FacePoints(
        np.concatenate([part.x for part in parts]),
        np.concatenate([part.area for part in parts]),
        sparse.vstack([part.values for part in parts], format="csr"),
    )

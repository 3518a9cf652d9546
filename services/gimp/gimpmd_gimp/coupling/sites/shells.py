"""The boxes of free atoms and of active sites around which a continuum lies, and the body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gimpmd_schemas.arrays import Bools, Floats
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.zones import Box


@dataclass(frozen=True)
class Shells:
    """Regions within the planes, as unions of boxes, which may overlap.

    Attributes
    ----------
    free : tuple of Box
        Boxes within plane 1 (length); infinite where there is no plane, at faces of the body or
        along periodic axes.
    active : tuple of Box
        Boxes within plane 2, in the same order; each holds its box of free atoms.
    """

    free: tuple[Box, ...]
    active: tuple[Box, ...]

    def lines(self, axis: int) -> Floats:
        """Coordinates of all planes normal to an axis, ascending."""
        return np.unique([end for box in (*self.free, *self.active) for end in box[axis]])


def body_of(grid: BackgroundGrid) -> Box:
    """Box that the grid covers; infinite along periodic axes, where the body has no face."""
    return tuple(
        (-np.inf, np.inf) if periodic else ends
        for ends, periodic in zip(grid.box, grid.periodic, strict=True)
    )


def depth(boxes: Sequence[Box], x: Floats) -> Floats:
    """Depth of positions below the surface of a union of boxes, shape ``(n,)``.

    It is positive inside. Outside it is minus the distance from the boxes, by the longest
    component. Where boxes overlap, the depth in the deepest of them counts.

    Parameters
    ----------
    x : ndarray, shape ``(n, d)``
    """
    deepest = np.full(len(x), -np.inf)
    for box in boxes:
        low, high = np.array(box).T
        deepest = np.maximum(deepest, np.minimum(x - low, high - x).min(axis=1))
    return deepest


def inside(boxes: Sequence[Box], x: Floats) -> Bools:
    """Tell which positions ``(n, d)`` lie in a union of boxes."""
    return np.asarray(depth(boxes, x) > 0.0)


def grown(boxes: Sequence[Box], by: float) -> tuple[Box, ...]:
    """Boxes with all faces moved outward."""
    return tuple(tuple((low - by, high + by) for low, high in box) for box in boxes)

"""The boxes of free atoms and of active sites around which a continuum lies, and the body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gimpmd_schemas.arrays import Bools, Floats
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.zones import Box


class Face(NamedTuple):
    """A face of the body: the axis that is normal to it, and its coordinate (length)."""

    axis: int
    end: float


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


def faces_met(grid: BackgroundGrid, shells: Shells) -> list[Face]:
    """Faces of the body at which planes end."""
    met = []
    for axis, pair in enumerate(body_of(grid)):
        boxes = [b for b in shells.free if any(np.isfinite(b[k]).any() for k in _but(axis, b))]
        for side, end in enumerate(pair):
            if np.isfinite(end) and any(np.isinf(box[axis][side]) for box in boxes):
                met.append(Face(axis, end))
    return met


def _but(axis: int, box: Box) -> list[int]:
    return [k for k in range(len(box)) if k != axis]


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

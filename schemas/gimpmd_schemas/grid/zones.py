"""The three zones of the transition region (paper section 4.1), measured by depth.

*Depth* is the distance inward from the nearest face of the MD region that the continuum
touches; faces of the region on the rim of the domain, or across a periodic axis, are no
interface. With several regions it is the largest of the depths in each. From outside in: the outer
zone (boundary atoms follow the grid), the incommunicado zone, the inner zone (material points
follow the atoms); points deeper than that are dropped.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.grid.background import BackgroundGrid

Box = tuple[tuple[float, float], ...]
"""Lower and upper coordinate along each axis."""


@dataclass(frozen=True)
class MdRegion:
    """Where an MD region lies in the continuum.

    Parameters
    ----------
    box : Box
        ``((xlo, xhi), (ylo, yhi))``.
    interfaces : tuple of (bool, bool)
        For each axis, whether the lower and the upper face of the region are interfaces.
    """

    box: Box
    interfaces: tuple[tuple[bool, bool], ...]

    def depth(self, x: Floats) -> Floats:
        """Depth of positions ``x``, shape ``(n, d)``; negative outside; inf with no interface."""
        depth = np.full(x.shape[0], np.inf)
        for axis, (low, high) in enumerate(self.interfaces):
            if low:
                depth = np.minimum(depth, x[:, axis] - self.box[axis][0])
            if high:
                depth = np.minimum(depth, self.box[axis][1] - x[:, axis])
        return depth

    def within(self, depth: float) -> Box:
        """Box of the region deeper than ``depth`` (unbounded where there is no interface)."""
        sides = []
        for (low, high), (is_low, is_high) in zip(self.box, self.interfaces, strict=True):
            sides.append((low + depth if is_low else -np.inf, high - depth if is_high else np.inf))
        return tuple(sides)


@dataclass(frozen=True)
class Zones:
    """Where the MD regions lie in the continuum and how wide their zones are.

    Parameters
    ----------
    regions : tuple of MdRegion
        Apart from each other.
    outer, incommunicado, inner, filter : float
        Widths (length units). ``filter`` reaches outward from the regions' faces.
    """

    regions: tuple[MdRegion, ...]
    outer: float
    incommunicado: float
    inner: float
    filter: float

    @property
    def handover(self) -> float:
        """Depth at which material points begin to follow the atoms."""
        return self.outer + self.incommunicado

    @property
    def innermost(self) -> float:
        """Depth beyond which there are no material points."""
        return self.handover + self.inner

    @property
    def energy_plane(self) -> float:
        """Depth that parts the energy of the two sides: the middle of the buffer."""
        return self.outer + 0.5 * self.incommunicado

    def depth(self, x: Floats) -> Floats:
        """Largest depth of positions ``x``, shape ``(n, d)``, in a region; negative outside all."""
        depth = self.regions[0].depth(x)
        for region in self.regions[1:]:
            depth = np.maximum(depth, region.depth(x))
        return depth

    def inner_nodes(self, grid: BackgroundGrid) -> Ints:
        """Ids of the nodes that inner points may touch: what the MD side offers."""
        return self._band(grid, self.handover, self.innermost)

    def outer_nodes(self, grid: BackgroundGrid) -> Ints:
        """Ids of the nodes that boundary atoms may touch: what the continuum offers."""
        return self._band(grid, 0.0, self.outer)

    def _band(self, grid: BackgroundGrid, low: float, high: float) -> Ints:
        """Canonical nodes near depths low to high: a stencil's reach (2 h) and 1 h to drift."""
        reach = (3.0 - 1e-6) * grid.cell  # depths may fall on nodes: the same ones in any units
        x = grid.positions()
        touched = np.zeros(grid.size, dtype=np.bool_)
        for region in self.regions:
            depth = region.depth(x)
            near = (depth > low - reach) & (depth < high + reach) & grid.canonical()
            for axis, (lo, hi) in enumerate(region.box):
                near &= (x[:, axis] > lo - reach) & (x[:, axis] < hi + reach)
            touched |= near
        return np.flatnonzero(touched).astype(np.int64)


def _edges(region: Box, counts: tuple[int, int]) -> list[Floats]:
    return [np.linspace(lo, hi, n + 1) for (lo, hi), n in zip(region, counts, strict=True)]


def patches(region: Box, counts: tuple[int, int]) -> list[Box]:
    """Cut a region into ``counts[0] x counts[1]`` equal patches, in C order of the ranks."""
    x, y = _edges(region, counts)
    return [
        ((float(x[i]), float(x[i + 1])), (float(y[j]), float(y[j + 1])))
        for i in range(counts[0])
        for j in range(counts[1])
    ]


def owners(region: Box, counts: tuple[int, int], x: Floats) -> Ints:
    """Rank whose patch holds each position; positions outside go to the nearest patch.

    Parameters
    ----------
    x : ndarray, shape ``(n, 2)``

    Returns
    -------
    ndarray of int64, shape ``(n,)``
    """
    # between the same edges as ``patches``, so that round-off cannot give a node two owners
    i, j = (
        np.searchsorted(edges[1:-1], x[:, axis], side="right")
        for axis, edges in enumerate(_edges(region, counts))
    )
    return np.asarray(i * counts[1] + j, dtype=np.int64)


def cut(box: Box, limits: Box) -> Box:
    """The part of a box within limits, which may be infinite."""
    return tuple(
        (max(low, start), min(high, end))
        for (low, high), (start, end) in zip(box, limits, strict=True)
    )


def in_box(box: Box, x: Floats) -> Bools:
    """Which positions ``x``, shape ``(n, d)``, lie in the half-open box."""
    inside = np.ones(x.shape[0], dtype=np.bool_)
    for axis, (lo, hi) in enumerate(box):
        inside &= (x[:, axis] >= lo) & (x[:, axis] < hi)
    return inside

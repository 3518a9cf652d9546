"""The three zones of the transition region (paper section 4.1), measured by depth.

The *depth* of a position is its distance inward from the nearest interface, that is, from the
nearest face of the MD region that borders on the continuum. Faces of the region on the edge of the
domain or across a periodic axis are not interfaces. With several regions, the depth is the largest
of the depths in the regions. From the outside inward, the zones are

- the outer zone, where boundary atoms follow the grid,
- the incommunicado zone, where neither side follows the other,
- the inner zone, where material points follow the atoms.

There are no material points deeper than the inner zone.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np

from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.grid.background import BackgroundGrid

Box = tuple[tuple[float, float], ...]
"""Lower and upper coordinate along each axis."""


@dataclass(frozen=True)
class MdRegion:
    """An MD region, and which of its faces border on the continuum.

    Parameters
    ----------
    box : Box
        Lower and upper face along each axis: ``((xlo, xhi), (ylo, yhi), ...)``.
    interfaces : tuple of (bool, bool)
        For each axis, whether the lower and the upper face of the region are interfaces.
    """

    box: Box
    interfaces: tuple[tuple[bool, bool], ...]

    def depth(self, x: Floats) -> Floats:
        """Depth of positions ``x``, shape ``(n, d)``; negative outside, inf without interfaces."""
        depth = np.full(x.shape[0], np.inf)
        for axis, (low, high) in enumerate(self.interfaces):
            if low:
                depth = np.minimum(depth, x[:, axis] - self.box[axis][0])
            if high:
                depth = np.minimum(depth, self.box[axis][1] - x[:, axis])
        return depth

    def within(self, depth: float) -> Box:
        """Box of the positions deeper than ``depth``; unbounded where there is no interface."""
        sides = []
        for (low, high), (is_low, is_high) in zip(self.box, self.interfaces, strict=True):
            sides.append((low + depth if is_low else -np.inf, high - depth if is_high else np.inf))
        return tuple(sides)


@dataclass(frozen=True)
class Zones:
    """The MD regions, and the widths of their zones.

    Parameters
    ----------
    regions : tuple of MdRegion
        Regions do not overlap.
    outer, incommunicado, inner, filter : float
        Widths (length units). The filter zone extends outward from the interfaces.
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
        """Depth below which there are no material points."""
        return self.handover + self.inner

    @property
    def energy_plane(self) -> float:
        """Depth that divides the energy between the sides: the middle of the incommunicado zone."""
        return self.outer + 0.5 * self.incommunicado

    def depth(self, x: Floats) -> Floats:
        """Depth of positions ``x``, shape ``(n, d)``: negative outside all regions."""
        depth = self.regions[0].depth(x)
        for region in self.regions[1:]:
            depth = np.maximum(depth, region.depth(x))
        return depth

    def inner_nodes(self, grid: BackgroundGrid) -> Ints:
        """Ids of the nodes that points of the inner zone may touch: the MD side offers them."""
        return self._band(grid, self.handover, self.innermost)

    def outer_nodes(self, grid: BackgroundGrid) -> Ints:
        """Ids of the nodes that boundary atoms may touch: the continuum offers them."""
        return self._band(grid, 0.0, self.outer)

    def _band(self, grid: BackgroundGrid, low: float, high: float) -> Ints:
        """Ids of the canonical nodes that particles at depths ``low`` to ``high`` may touch.

        A particle touches nodes up to 2 h away, and it may drift by 1 h.
        """
        # a little less, since depths may fall on nodes: the set is then the same in all units
        reach = (3.0 - 1e-6) * grid.cell
        x = grid.positions()
        touched = np.zeros(grid.size, dtype=np.bool_)
        for region in self.regions:
            depth = region.depth(x)
            near = (depth > low - reach) & (depth < high + reach) & grid.canonical()
            for axis, (lo, hi) in enumerate(region.box):
                near &= (x[:, axis] > lo - reach) & (x[:, axis] < hi + reach)
            touched |= near
        return np.flatnonzero(touched).astype(np.int64)


def patches(region: Box, counts: tuple[int, ...]) -> list[Box]:
    """Cut a region into equal patches, ``counts[a]`` along axis a, in C order of the ranks."""
    edges = [edge.tolist() for edge in _edges(region, counts)]
    return list(product(*(pairwise(edge) for edge in edges)))


def owners(region: Box, counts: tuple[int, ...], x: Floats) -> Ints:
    """Rank whose patch holds each position; the nearest patch holds positions outside the region.

    Parameters
    ----------
    x : ndarray, shape ``(n, d)``

    Returns
    -------
    ndarray of int64, shape ``(n,)``
    """
    # the same edges as in ``patches``, so that round-off cannot give a node two owners
    index = tuple(
        np.searchsorted(edges[1:-1], x[:, axis], side="right")
        for axis, edges in enumerate(_edges(region, counts))
    )
    return np.asarray(np.ravel_multi_index(index, counts), dtype=np.int64)


def _edges(region: Box, counts: tuple[int, ...]) -> list[Floats]:
    return [np.linspace(lo, hi, n + 1) for (lo, hi), n in zip(region, counts, strict=True)]


def cut(box: Box, limits: Box) -> Box:
    """Intersect a box with limits, which may be infinite."""
    return tuple(
        (max(low, start), min(high, end))
        for (low, high), (start, end) in zip(box, limits, strict=True)
    )


def in_box(box: Box, x: Floats) -> Bools:
    """Tell which positions ``x``, shape ``(n, d)``, lie in the half-open box."""
    inside = np.ones(x.shape[0], dtype=np.bool_)
    for axis, (lo, hi) in enumerate(box):
        inside &= (x[:, axis] >= lo) & (x[:, axis] < hi)
    return inside

"""The interface at planes: planes that separate free atoms from the continuum.

Atoms inside the planes are free. Outside the planes the body is continuum, and the atoms that the
user's script makes there, up to the faces of the MD region, are *ghosts*. Ghosts move with the
nodes, and they return to the nodes the forces that free atoms exert on them. Both transfers use the
linear hat functions at the positions of the ghosts at rest.

In the sites scheme there is a second plane outside each plane. The energies of the ghosts between
the two planes count too, and hat functions are averaged over one period of the crystal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.zones import Box, cut

NO_WEIGHT = 1e-11
"""Averaged weights below this are round-off, of an atom whose period ends on a line of nodes."""


@dataclass(frozen=True)
class Interface:
    """Planes around the free atoms of one MD region.

    Parameters
    ----------
    planes : Box
        Lower and upper plane along each axis (length units); infinite where there is no plane.
    region : Box
        The MD region, which holds all atoms including the ghosts.
    second : Box, optional
        The second planes of the sites scheme, as ``planes``.
    period : tuple of float, optional
        Period of the crystal along each axis (length), over which the weights of ghosts are
        averaged; None: the weights are those at the positions of the ghosts.
    """

    planes: Box
    region: Box
    second: Box | None = None
    period: tuple[float, ...] | None = None

    def free(self, x: Floats) -> Bools:
        """Tell which positions at rest, shape ``(n, d)``, are those of free atoms."""
        inside = np.ones(x.shape[0], dtype=np.bool_)
        for axis, (low, high) in enumerate(self.planes):
            inside &= (x[:, axis] > low) & (x[:, axis] < high)
        return inside

    def off(self, x: Floats) -> Bools:
        """Tell which positions at rest, shape ``(n, d)``, lie beyond the second planes."""
        outside = np.zeros(x.shape[0], dtype=np.bool_)
        for axis, (low, high) in enumerate(self.second or ()):
            outside |= (x[:, axis] < low) | (x[:, axis] > high)
        return outside

    def half_widths(self, grid: BackgroundGrid) -> Floats:
        """Half-widths of the ghosts in cells: half a period of the crystal, or zero."""
        return 0.5 * np.array(self.period or (0.0,) * grid.dim) / grid.cell

    def depth(self, x: Floats) -> Floats:
        """Depth of positions, shape ``(n, d)``, below the planes: negative among the ghosts."""
        depth = np.full(len(x), np.inf)
        for axis, (low, high) in enumerate(self.planes):
            depth = np.minimum(depth, np.minimum(x[:, axis] - low, high - x[:, axis]))
        return depth

    def core(self) -> Box:
        """Box of the free atoms; the MD region ends it where there is no plane."""
        return cut(self.region, self.planes)

    def ghost_nodes(self, grid: BackgroundGrid) -> Ints:
        """Ids of the canonical nodes that ghosts may touch.

        They are less than a cell, or a cell and half a period, from a ghost.
        """
        x = grid.positions()
        near, deep = grid.canonical(), np.ones(grid.size, dtype=np.bool_)
        period = self.period or (0.0,) * grid.dim
        for axis, ((low, high), (start, end)) in enumerate(
            zip(self.planes, self.region, strict=True)
        ):
            h = (1.0 - 1e-9) * (grid.cell + 0.5 * period[axis])
            near &= (x[:, axis] > start - h) & (x[:, axis] < end + h)
            deep &= (x[:, axis] > low + h) & (x[:, axis] < high - h)
        return np.flatnonzero(near & ~deep).astype(np.int64)


def deepest(interfaces: Sequence[Interface], x: Floats) -> Floats:
    """Depth of positions, shape ``(n, d)``, below the planes of the region where it is largest."""
    depth: Floats = np.max([interface.depth(x) for interface in interfaces], axis=0)
    return depth

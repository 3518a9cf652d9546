"""The interface of the force scheme: planes that separate free atoms from the continuum.

Atoms inside the planes are free. Outside the planes the body is continuum, and the atoms that the
user's script makes there, up to the faces of the MD region, are *ghosts*. Ghosts move with the
nodes, and they return to the nodes the forces that free atoms exert on them. Both transfers use the
linear hat functions at the positions of the ghosts at rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.zones import Box, cut


@dataclass(frozen=True)
class Interface:
    """Planes of the force scheme around the free atoms of one MD region.

    Parameters
    ----------
    planes : Box
        Lower and upper plane along each axis (length units); infinite where there is no plane.
    region : Box
        The MD region, which holds all atoms including the ghosts.
    """

    planes: Box
    region: Box

    def free(self, x: Floats) -> Bools:
        """Tell which positions at rest, shape ``(n, d)``, are those of free atoms."""
        inside = np.ones(x.shape[0], dtype=np.bool_)
        for axis, (low, high) in enumerate(self.planes):
            inside &= (x[:, axis] > low) & (x[:, axis] < high)
        return inside

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
        """Ids of the canonical nodes that ghosts may touch: those less than a cell from a ghost."""
        x, h = grid.positions(), (1.0 - 1e-9) * grid.cell
        near, deep = grid.canonical(), np.ones(grid.size, dtype=np.bool_)
        for axis, ((low, high), (start, end)) in enumerate(
            zip(self.planes, self.region, strict=True)
        ):
            near &= (x[:, axis] > start - h) & (x[:, axis] < end + h)
            deep &= (x[:, axis] > low + h) & (x[:, axis] < high - h)
        return np.flatnonzero(near & ~deep).astype(np.int64)

"""The interface of the force scheme: planes that part free atoms from the continuum.

Inside the planes atoms are free; outside them the body is continuum. Atoms outside, which the
user's script makes as far as the MD region reaches, are *ghosts*: they move with the nodes and hand
the forces that free atoms exert on them back, both by the linear hat functions (half-width 0) at
their positions at rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.zones import Box, cut


@dataclass(frozen=True)
class Interface:
    """Planes of the force scheme about one MD region.

    Parameters
    ----------
    planes : Box
        Along each axis the lower and the upper plane (length), infinite where there is none.
    region : Box
        The MD region: atoms, ghosts included, lie inside.
    """

    planes: Box
    region: Box

    def free(self, x: Floats) -> Bools:
        """Which positions at rest, shape ``(n, 2)``, are those of free atoms."""
        inside = np.ones(x.shape[0], dtype=np.bool_)
        for axis, (low, high) in enumerate(self.planes):
            inside &= (x[:, axis] > low) & (x[:, axis] < high)
        return inside

    def core(self) -> Box:
        """The box of the free atoms: planes, and faces of the MD region where there is none."""
        return cut(self.region, self.planes)

    def ghost_nodes(self, grid: BackgroundGrid) -> Ints:
        """Ids of the canonical nodes that ghosts may touch: less than a cell from one."""
        x, h = grid.positions(), (1.0 - 1e-9) * grid.cell
        near, deep = grid.canonical(), np.ones(grid.size, dtype=np.bool_)
        for axis, ((low, high), (start, end)) in enumerate(
            zip(self.planes, self.region, strict=True)
        ):
            near &= (x[:, axis] > start - h) & (x[:, axis] < end + h)
            deep &= (x[:, axis] > low + h) & (x[:, axis] < high - h)
        return np.flatnonzero(near & ~deep).astype(np.int64)


def interfaces_of(case: Case) -> tuple[Interface, ...]:
    """Interface of each MD region of a resolved case.

    Raises
    ------
    ValueError
        LAMMPS has not been asked for the planes yet.
    """
    if case.coupling.planes is None:
        raise ValueError("the planes of the interface have not been found yet")
    return tuple(
        Interface(planes.limits(), region)
        for planes, region in zip(
            case.coupling.each_planes().values(), case.md_regions(), strict=True
        )
    )

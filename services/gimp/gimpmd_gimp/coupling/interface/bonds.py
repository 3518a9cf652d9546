"""Bonds between free atoms and ghosts, and where they cross the planes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from gimpmd_gimp.coupling.interface.lattice import Lattice
from gimpmd_gimp.coupling.interface.weights import Sparse, hats, means
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.planes import Interface

ROUNDING = 1e-6
"""Cells by which a site may lie outside a face of the domain and still be meant to lie on it."""


@dataclass(frozen=True, eq=False)
class Bonds:
    """Bonds that cross a plane, each once, from its free atom to its ghost.

    Attributes
    ----------
    kind : ndarray of int64, shape ``(n,)``
        Number of the bond in the crystal.
    sign : ndarray, shape ``(n,)``
        1 if the bond runs along the crystal's vector, -1 against it.
    free, ghost : ndarray, shape ``(n, 2)``
        Sites of the two ends; beyond a periodic face the ghost's is that of its image.
    crossing : ndarray, shape ``(n, 2)``
        Where the bond leaves the box of the free atoms.
    axis : ndarray of int64, shape ``(n,)``
        Axis along which the plane runs.
    theta : ndarray, shape ``(n,)``
        Fraction of the bond outside.
    """

    kind: Ints
    sign: Floats
    free: Floats
    ghost: Floats
    crossing: Floats
    axis: Ints
    theta: Floats

    @property
    def count(self) -> int:
        """Number of bonds."""
        return int(self.kind.size)

    def take(self, chosen: Ints | Bools) -> Bonds:
        """Bonds chosen by a mask or by indices."""
        return Bonds(**{f.name: getattr(self, f.name)[chosen] for f in fields(self)})


def join(parts: Sequence[Bonds]) -> Bonds:
    """Bonds of all parts, one part after the other."""
    return Bonds(
        **{f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Bonds)}
    )


def domain(grid: BackgroundGrid) -> tuple[Floats, Floats]:
    """Lower and upper corner of the domain."""
    low = np.asarray(grid.origin)
    return low, low + grid.cell * np.asarray(grid.cells)


def find_bonds(lattice: Lattice, interface: Interface, grid: BackgroundGrid) -> Bonds:
    """All bonds between a free atom and a ghost.

    There are sites wherever the domain is. At a face of the domain that is no interface the crystal
    ends; across a periodic one it goes on, and a bond is that of the free atom in the domain.

    Raises
    ------
    BackendError
        A ghost that free atoms are bound to would lie outside the MD region.
    """
    low, high = domain(grid)
    free = _near_planes(lattice, interface, grid)
    parts = []
    for kind, vector in enumerate(lattice.bonds):
        for sign in (1.0, -1.0):
            ghost = free + sign * vector
            kept = ~interface.free(ghost)
            for axis in range(2):
                if not grid.periodic[axis]:
                    margin = ROUNDING * grid.cell
                    kept &= ghost[:, axis] >= low[axis] - margin
                    kept &= ghost[:, axis] <= high[axis] + margin
            parts.append(_cross(interface, kind, sign, free[kept], ghost[kept]))
    bonds = join(parts)
    _check_ghosts(bonds, interface, grid)
    return bonds


def _near_planes(lattice: Lattice, interface: Interface, grid: BackgroundGrid) -> Floats:
    """Sites of free atoms within a bond's length of a plane, each once."""
    low, high = domain(grid)
    margin = ROUNDING * grid.cell
    # a site on a face of the domain exists; of two on opposite periodic faces one does
    start = low - margin
    end = np.where(grid.periodic, high - margin, high + margin)
    reach, strips = 1.001 * lattice.reach, []
    for axis, planes in enumerate(interface.planes):
        for plane, inward in zip(planes, (1.0, -1.0), strict=True):
            if np.isfinite(plane):
                ends = np.sort([plane, plane + inward * reach])
                box = start.copy(), end.copy()
                box[0][axis] = max(ends[0], start[axis])
                box[1][axis] = min(ends[1], end[axis])
                strips.append(lattice.sites(*box))
    sites = np.concatenate([np.empty((0, 2)), *strips])
    index = np.rint((sites - lattice.origin) @ np.linalg.inv(lattice.vectors))
    _, once = np.unique(index, axis=0, return_index=True)
    sites = sites[np.sort(once)]
    return sites[interface.free(sites)]


def _cross(interface: Interface, kind: int, sign: float, free: Floats, ghost: Floats) -> Bonds:
    """Bonds of one kind and where each leaves the box of the free atoms."""
    n, step = free.shape[0], ghost - free
    t, normal, level = np.full(n, np.inf), np.zeros(n, dtype=np.int64), np.zeros(n)
    for axis, (low, high) in enumerate(interface.planes):
        for plane, beyond in ((low, ghost[:, axis] < low), (high, ghost[:, axis] > high)):
            where = np.full(n, np.inf)
            where[beyond] = (plane - free[beyond, axis]) / step[beyond, axis]
            first = where < t
            t[first], normal[first], level[first] = where[first], axis, plane
    crossing = free + t[:, None] * step
    crossing[np.arange(n), normal] = level
    return Bonds(
        kind=np.full(n, kind, dtype=np.int64),
        sign=np.full(n, sign),
        free=free,
        ghost=ghost,
        crossing=crossing,
        axis=1 - normal,
        theta=1.0 - t,
    )


def _check_ghosts(bonds: Bonds, interface: Interface, grid: BackgroundGrid) -> None:
    margin = ROUNDING * grid.cell
    for axis, (planes, sides) in enumerate(zip(interface.planes, interface.region, strict=True)):
        x = bonds.ghost[:, axis]
        for plane, side, short in (
            (planes[0], sides[0], sides[0] - x),
            (planes[1], sides[1], x - sides[1]),
        ):
            if np.isfinite(plane) and short.max(initial=0.0) > margin:
                raise BackendError(
                    f"coupling.planes: the plane at {'xy'[axis]} = {plane:g} is closer to "
                    f"the face of md.region at {side:g} than the longest bond, so some ghost atoms "
                    f"are missing; move it inward by {short.max():g}, or use coupling.scheme: "
                    "velocity"
                )


def ghost_weights(bonds: Bonds, grid: BackgroundGrid) -> Sparse:
    """Weights by which nodes move the bonds' ghosts, shape ``(n, grid.size)``."""
    return hats(grid, bonds.ghost)


def crossing_weights(bonds: Bonds, lattice: Lattice, grid: BackgroundGrid) -> Sparse:
    """Weights by which nodes move the crossings, shape ``(n, grid.size)``.

    A crossing moves as the plane does on average over one period of the rows along it, so that
    the crossings of a period share the traction evenly. Near a face of the domain the stretch is
    shorter, on both sides, so that its middle stays the crossing.
    """
    low, high = domain(grid)
    start, end = bonds.crossing.copy(), bonds.crossing.copy()
    for axis in np.unique(bonds.axis):
        here = np.flatnonzero(bonds.axis == axis)
        x = bonds.crossing[here, axis]
        half = np.full(here.size, 0.5 * lattice.period(int(axis)))
        if not grid.periodic[axis]:
            rim = np.minimum(x - low[axis], high[axis] - x)
            half = np.minimum(half, np.maximum(rim, 0.0))
        start[here, axis] -= half
        end[here, axis] += half
    return means(grid, start, end)

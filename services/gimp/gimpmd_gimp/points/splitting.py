"""Points that cross the rim of a level: they split on the way in and merge on the way out.

Near the rim a point represents the composite basis exactly only on the lattice of the finer
level, where hanging nodes continue the coarser field. Therefore a point of the coarser level whose
domain comes near the rim joins the finer level unchanged, as a *large* point of that level. It
returns when its domain has left the rim. A large point well inside the level splits into ``2^d``
equal ones. When all ``2^d`` points of a family have left the level, they merge into a large one.
F and the weights stay as they are, so a uniform stress causes no force wherever the points stand.

All velocities must be known at the present time when points change level. Mass and momentum are
exact. Parts get the velocity of the grid at their position, to first order, and the F and history
variables of their parent: the kinetic energy changes at second order in the size of a point, the
strain energy does not change. A merged point takes the mean velocity, F and history variables of
its parts: both energies change at second order in the differences between the parts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.points.distribution import corners, family, lattice_id, owners
from gimpmd_gimp.points.material_points import Configuration, MaterialPoints, join, take
from gimpmd_schemas.arrays import Bools, Floats, Int32s, Ints

NEAR, CLEAR = 0.2, 0.25
"""Gaps between the domain of a point and the rim, in coarser cells. Below the first gap a point
joins the finer level, beyond the second one a large point returns. The first gap leaves room for
the motion in one step."""

SPLIT_DEPTH = 0.25
"""Depth inside the finer level at which a large point splits, in coarser cells."""

STRAY_AWAY = 0.5
"""Distance outside a level at which a point leaves its family and becomes a small point of the
coarser level, in coarser cells."""

LARGEST = 0.5
"""Largest half-width, in cells, that a stencil of three nodes can hold."""


@dataclass(frozen=True)
class Changes:
    """Points of this rank that change: disjoint masks of shape ``(n,)``.

    Attributes
    ----------
    up, down : points that join the next finer or coarser level unchanged.
    split : points that split.
    out : points that merge if their whole family can.
    """

    up: Bools
    down: Bools
    split: Bools
    out: Bools


class Splitting:
    """Finds the points of one rank that change level, and changes them.

    Parameters
    ----------
    mesh : Mesh
    configuration : Configuration
    nominal_half : float
        Half-width, in cells, of a point that is not large.
    """

    def __init__(self, mesh: Mesh, configuration: Configuration, nominal_half: float) -> None:
        self._mesh, self._h = mesh, mesh.hierarchy
        self._configuration, self._nominal_half = configuration, nominal_half

    def watch(self, points: MaterialPoints) -> None:
        """Note which points may change level before they are sorted again; collective."""
        if self._h.top == 0:
            return
        self._rows, self._leash = self._near_rims(points)
        self._start = points.on_grid(self._configuration)[self._rows]
        self._waiting = int(self._count(points)[1])

    def is_due(self, points: MaterialPoints) -> bool:
        """Whether points on any rank change level now; collective."""
        if self._h.top == 0:
            return False
        moved = points.on_grid(self._configuration)[self._rows] - self._start
        far = np.abs(moved).max(initial=0.0) >= self._leash
        return self._mesh.largest(float(far)) > 0.0 and self._any(points)

    def find(self, points: MaterialPoints) -> Changes | None:
        """All points that change level now, or None if no rank has any; collective."""
        if self._h.top == 0 or not self._any(points):
            return None
        return self._find(points, np.arange(points.count))

    def apply(self, points: MaterialPoints, changes: Changes, L: Floats) -> MaterialPoints:
        """Return the points after the changes; collective.

        Parameters
        ----------
        L : ndarray, shape ``(n, d, d)``
            Velocity gradients of the points that split.
        """
        mesh = self._mesh
        leaving = take(points, changes.out)
        if mesh.ranks > 1:  # a family may be spread over ranks
            leaving = join(mesh.comm.allgather(leaving))
        merged = self._merge(leaving)
        if mesh.ranks > 1:
            rank, _ = owners(mesh, merged, self._configuration)
            merged = take(merged, rank == mesh.rank)
        same = ~(changes.up | changes.down | changes.split | changes.out)
        return join(
            [
                take(points, same),
                _relabel(take(points, changes.up), 1),
                _relabel(take(points, changes.down), -1),
                self._split(take(points, changes.split), L),
                merged,
            ]
        )

    def _any(self, points: MaterialPoints) -> bool:
        """Whether any point on any rank changes level, or more members of a family may merge."""
        changing, out = self._count(points)
        return bool(changing > 0 or out != self._waiting)

    def _count(self, points: MaterialPoints) -> Ints:
        """How many points change level or split, and how many wait to merge, on all ranks."""
        changes = self._find(points, self._rows)
        own = np.array([np.sum(changes.up | changes.down | changes.split), np.sum(changes.out)])
        return own if self._mesh.ranks == 1 else np.asarray(self._mesh.comm.allreduce(own))

    def _near_rims(self, p: MaterialPoints) -> tuple[Ints, float]:
        """Points that may change before they are sorted again, and how far they may move.

        Returns
        -------
        rows : ndarray of int64
            Ascending.
        leash : float
            No point passes a limit of ``_find`` before one has moved this far along an axis.
        """
        own, finer = _distances(p.on_grid(self._configuration), p.level, self._h)
        edge = self._h.cell / 2.0**p.level
        rows: Ints = np.flatnonzero((np.abs(own) < 2.5 * edge) | (np.abs(finer) < 1.25 * edge))
        own, finer, edge = own[rows], finer[rows], edge[rows]
        half = p.half[rows].max(axis=1)
        large = half > 1.5 * self._nominal_half
        fits = np.where(large, half, 2.0 * half) <= LARGEST
        bounds = (
            finer - np.where(fits, half + NEAR, -SPLIT_DEPTH) * edge,
            own - np.where(large, -SPLIT_DEPTH, np.where(fits, 0.0, CLEAR)) * 2.0 * edge,
            own - np.where(large, CLEAR + 0.5 * half, STRAY_AWAY) * 2.0 * edge,
        )
        return rows, min(float(np.abs(gap).min(initial=np.inf)) for gap in bounds)

    def _find(self, p: MaterialPoints, rows: Ints) -> Changes:
        """Which points among ``rows`` change level, split, or may merge."""
        own, finer = _distances(p.on_grid(self._configuration)[rows], p.level[rows], self._h)
        edge = self._h.cell / 2.0 ** p.level[rows]
        half = p.half[rows].max(axis=1)
        large = half > 1.5 * self._nominal_half
        fits = np.where(large, half, 2.0 * half) <= LARGEST
        near = np.where(fits, finer - half * edge < NEAR * edge, finer < -SPLIT_DEPTH * edge)
        clear = own - half * edge > CLEAR * 2.0 * edge
        strayed = own > STRAY_AWAY * 2.0 * edge
        split = (large & (own < -SPLIT_DEPTH * 2.0 * edge)) | (near & ~fits)
        out = ~large & ~strayed & ~split & (own > np.where(fits, 0.0, CLEAR * 2.0 * edge))
        down = ((large & clear) | (~large & strayed)) & ~split

        def mask(chosen: Bools) -> Bools:
            whole = np.zeros(p.count, dtype=np.bool_)
            whole[rows] = chosen
            return whole

        up = near & ~split & ~out
        return Changes(up=mask(up), down=mask(down), split=mask(split), out=mask(out))

    def _split(self, parents: MaterialPoints, L: Floats) -> MaterialPoints:
        """Points of nominal size on the finer level in place of their parents."""
        large = parents.half[:, 0] > 1.5 * self._nominal_half
        wholes = join([take(parents, large), _relabel(take(parents, ~large), 1)])
        L = np.concatenate([L[large], L[~large]])
        edge = (self._h.cell / 2.0**wholes.level)[:, None]
        signs, parts = corners(self._h.dim), []
        for sign in signs:
            part = take(wholes, np.arange(wholes.count))
            offset = 0.5 * sign * part.half * edge
            moved = np.einsum("nij,nj->ni", part.F, offset)
            part.reference += offset
            part.x += moved
            # the velocity gradient is that on the grid
            along = offset if self._configuration == "reference" else moved
            part.v += np.einsum("nij,nj->ni", L, along)
            part.mass /= len(signs)
            part.volume /= len(signs)
            part.half *= 0.5
            parts.append(part)
        children = join(parts)
        children.id[:] = lattice_id(self._mesh, children)
        return children

    def _merge(self, points: MaterialPoints) -> MaterialPoints:
        """One large point for every complete family, on the coarser level if it is too large."""
        if points.count == 0:
            return points
        mesh = self._mesh
        keys = np.column_stack([points.level, family(mesh, points, points.level - 1)])
        _, which, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
        which = which.ravel()
        whole = count[which] == 2**points.dim
        if not whole.any():
            return points
        family_of = np.unique(which[whole], return_inverse=True)[1]
        merged = _relabel(_sum_up(take(points, whole), family_of), -1)
        merged.id[:] = lattice_id(mesh, merged)
        if 2.0 * self._nominal_half <= LARGEST:
            merged = _relabel(merged, 1)
        return join([take(points, ~whole), merged])


def _distances(x: Floats, level: Int32s, h: Hierarchy) -> tuple[Floats, Floats]:
    """Distances outside the points' own level and outside the next finer one, shape ``(n,)``."""
    own, finer = np.full(level.size, -np.inf), np.full(level.size, np.inf)
    for one in range(h.top):
        here, above = level == one, level == one + 1
        finer[here] = h.distance(one + 1, x[here])
        own[above] = h.distance(one + 1, x[above])
    return own, finer


def _sum_up(parts: MaterialPoints, which: Ints) -> MaterialPoints:
    """One point for each family, as large as its parts together."""
    first = np.unique(which, return_index=True)[1]
    merged = take(parts, first)

    def total(field: Floats) -> Floats:
        out = np.zeros((first.size, *field.shape[1:]))
        np.add.at(out, which, field)
        return out

    def mean(field: Floats, weight: Floats) -> Floats:
        wide = weight.reshape(-1, *[1] * (field.ndim - 1))
        shares: Floats = total(wide * field) / total(weight).reshape(-1, *[1] * (field.ndim - 1))
        return shares

    for name in ("x", "v", "dv"):
        getattr(merged, name)[:] = mean(getattr(parts, name), parts.mass)
    for name in ("reference", "F", "history"):
        getattr(merged, name)[:] = mean(getattr(parts, name), parts.volume)
    merged.mass[:], merged.volume[:] = total(parts.mass), total(parts.volume)
    merged.half *= 2.0
    return merged


def _relabel(points: MaterialPoints, up: int) -> MaterialPoints:
    """The same points on a level finer by ``up``: sizes in its cells, kicks over its steps."""
    out = take(points, np.arange(points.count))
    out.half *= 2.0**up
    out.level += np.int32(up)
    out.dv *= 0.5**up
    return out

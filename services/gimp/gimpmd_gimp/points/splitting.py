"""Points that cross the rim of a level: they split on the way in and merge on the way out.

Near the rim a point sees the composite basis exactly on the finer level's lattice alone, where
hanging nodes carry the coarser field on. So a point of the coarser level whose domain comes near
the rim goes over to the finer level as it is, a *large* point of that level, and back once its
domain has left. Large points within the level split into ``2^d`` equal ones; once all ``2^d`` of a
family have left it, they merge into a large one. With F and weights as they are, uniform stress
stays without force however points stand.

Changes are made with all velocities at the present time (``Solver.regroup``). Mass and momentum
are exact. Parts get the velocity that the grid has at their place, to first order, and their
parent's F and history variables: kinetic energy changes by second order in the size of a point,
strain energy not at all. A merger takes the mean of velocity, F and history variables: both
energies change by second order in what the parts differ by.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gimpmd_gimp.points.distribution import corners, family, lattice_id, owners
from gimpmd_gimp.points.material_points import Flags, MaterialPoints, join, take
from gimpmd_schemas.arrays import Bools, Floats, Ints

if TYPE_CHECKING:
    from gimpmd_gimp.grid.hierarchy import Hierarchy
    from gimpmd_gimp.step.solver import Solver

NEAR, CLEAR = 0.2, 0.25
"""Gaps between a point's domain and the rim, in coarser cells, within which the point belongs to
the finer level, and beyond which a large one goes back; the first leaves room for a step's way."""

SPLIT_DEPTH = 0.25
"""How far inside the finer level a large point splits, in coarser cells."""

STRAY_AWAY = 0.5
"""How far outside a point leaves its family and becomes a small point of the coarser level."""

LARGEST = 0.5
"""Largest half-width, in cells, that a stencil of three nodes holds."""


@dataclass(frozen=True)
class Changes:
    """Points of this rank that change: disjoint masks of shape ``(n,)``."""

    up: Bools
    down: Bools
    split: Bools
    out: Bools


def near_rims(solver: Solver) -> tuple[Ints, float]:
    """Points that may change before they are sorted anew, and how far none of them must come.

    Returns
    -------
    rows : ndarray of int64
        Ascending.
    leash : float
        Until a point has moved so far along an axis, none passes a bound of ``find_changes``.
    """
    p, h = solver.points, solver.hierarchy
    own, finer = _distances(solver.place, p.level, h)
    edge = h.cell / 2.0**p.level
    rows: Ints = np.flatnonzero((np.abs(own) < 2.5 * edge) | (np.abs(finer) < 1.25 * edge))
    own, finer, edge = own[rows], finer[rows], edge[rows]
    half = p.half[rows].max(axis=1)
    large = half > 1.5 * solver.nominal_half
    fits = np.where(large, half, 2.0 * half) <= LARGEST
    bounds = (
        finer - np.where(fits, half + NEAR, -SPLIT_DEPTH) * edge,
        own - np.where(large, -SPLIT_DEPTH, np.where(fits, 0.0, CLEAR)) * 2.0 * edge,
        own - np.where(large, CLEAR + 0.5 * half, STRAY_AWAY) * 2.0 * edge,
    )
    return rows, min(float(np.abs(gap).min(initial=np.inf)) for gap in bounds)


def find_changes(solver: Solver, rows: Ints) -> Changes:
    """Which points of those in ``rows`` change level, split, or merge if all their family can."""
    p, h = solver.points, solver.hierarchy
    own, finer = _distances(solver.place[rows], p.level[rows], h)
    edge = h.cell / 2.0 ** p.level[rows]
    half = p.half[rows].max(axis=1)
    large = half > 1.5 * solver.nominal_half
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

    return Changes(up=mask(near & ~split & ~out), down=mask(down), split=mask(split), out=mask(out))


def _distances(x: Floats, level: Flags, h: Hierarchy) -> tuple[Floats, Floats]:
    """Distances outside the points' own level and outside the next finer one, shape ``(n,)``."""
    own, finer = np.full(level.size, -np.inf), np.full(level.size, np.inf)
    for one in range(h.top):
        here, above = level == one, level == one + 1
        finer[here] = h.distance(one + 1, x[here])
        own[above] = h.distance(one + 1, x[above])
    return own, finer


def change_levels(solver: Solver, changes: Changes) -> MaterialPoints:
    """Points after these changes; collective."""
    points, mesh = solver.points, solver.mesh
    leaving = take(points, changes.out)
    if mesh.ranks > 1:  # a family may be spread over ranks
        leaving = join(mesh.comm.allgather(leaving))
    merged = _merge(solver, leaving)
    if mesh.ranks > 1:
        rank, _ = owners(mesh, merged, solver.scheme.configuration)
        merged = take(merged, rank == mesh.rank)
    same = ~(changes.up | changes.down | changes.split | changes.out)
    return join(
        [
            take(points, same),
            _relabel(take(points, changes.up), 1),
            _relabel(take(points, changes.down), -1),
            _split(solver, np.flatnonzero(changes.split)),
            merged,
        ]
    )


def _split(solver: Solver, chosen: Ints) -> MaterialPoints:
    """Points of nominal size on the finer level in place of those chosen."""
    h, mesh = solver.hierarchy, solver.mesh
    L = solver.velocity_gradient(chosen)
    parents = take(solver.points, chosen)
    large = parents.half[:, 0] > 1.5 * solver.nominal_half
    wholes = join([take(parents, large), _relabel(take(parents, ~large), 1)])
    L = np.concatenate([L[large], L[~large]])
    edge = (h.cell / 2.0**wholes.level)[:, None]
    signs, parts = corners(h.dim), []
    for sign in signs:
        part = take(wholes, np.arange(wholes.count))
        offset = 0.5 * sign * part.half * edge
        moved = np.einsum("nij,nj->ni", part.F, offset)
        part.reference += offset
        part.x += moved
        # the gradient is that on the grid
        along = offset if solver.fixed else moved
        part.v += np.einsum("nij,nj->ni", L, along)
        part.mass /= len(signs)
        part.volume /= len(signs)
        part.half *= 0.5
        parts.append(part)
    children = join(parts)
    children.id[:] = lattice_id(mesh, children)
    return children


def _merge(solver: Solver, points: MaterialPoints) -> MaterialPoints:
    """One large point for every whole family, of the coarser level if no stencil holds it."""
    if points.count == 0:
        return points
    mesh = solver.mesh
    keys = np.column_stack([points.level, family(mesh, points, points.level - 1)])
    _, which, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    which = which.ravel()
    whole = count[which] == 2**points.dim
    if not whole.any():
        return points
    family_of = np.unique(which[whole], return_inverse=True)[1]
    merged = _relabel(_sum_up(take(points, whole), family_of), -1)
    merged.id[:] = lattice_id(mesh, merged)
    if 2.0 * solver.nominal_half <= LARGEST:
        merged = _relabel(merged, 1)
    return join([take(points, ~whole), merged])


def _sum_up(parts: MaterialPoints, which: Ints) -> MaterialPoints:
    """One point for each family, of the size of its parts taken together."""
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
    """The same points on a level ``up`` finer: sizes count in its cells, kicks in its steps."""
    out = take(points, np.arange(points.count))
    out.half *= 2.0**up
    out.level += np.int32(up)
    out.dv *= 0.5**up
    return out

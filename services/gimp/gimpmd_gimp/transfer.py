"""Points that cross the rim of a level: they split on the way in and merge on the way out.

A point of a coarser level that has come a quarter of its cell into a finer one splits into
``2^d`` equal points of that level; points of a finer level that have left it by a quarter of a
coarser cell merge once all ``2^d`` of a family are out. Mass and momentum are exact. Parts get the
velocity that the grid has at their place, to first order, and their parent's F: kinetic energy
changes by second order in the size of a point, strain energy not at all. A merger takes the mean
of velocity and F: both energies change by second order in what the parts differ by.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gimpmd_gimp.placing import corners, family, lattice_id, owners
from gimpmd_gimp.points import MaterialPoints, join, take
from gimpmd_schemas.grid import Floats, Ints

if TYPE_CHECKING:
    from gimpmd_gimp.solver import Solver

SPLIT_DEPTH = 0.25
"""How far inside a finer level a point splits, in cells of its own level."""

MERGE_AWAY = 0.25
"""How far outside its level a family of points merges, in cells of the coarser level."""


STRAY_AWAY = 0.5
"""How far outside a point leaves its family and becomes a small point of the coarser level."""


def change_levels(solver: Solver) -> MaterialPoints:
    """Points after all splits and mergers that their positions ask for; collective."""
    points, h, mesh = solver.points, solver.hierarchy, solver.mesh
    if h.top == 0:
        return points
    edge = h.cell / 2.0**points.level
    entering, leaving = np.zeros(points.count, np.bool_), np.zeros(points.count, np.bool_)
    for level in range(h.top):
        entering |= (points.level == level) & (
            h.distance(level + 1, points.x) < -SPLIT_DEPTH * edge
        )
        leaving |= (points.level == level + 1) & (
            h.distance(level + 1, points.x) > MERGE_AWAY * 2.0 * edge
        )
    out = take(points, leaving)
    if mesh.ranks > 1:  # a family may be spread over ranks
        out = join(mesh.comm.allgather(out))
    merged = _merge(solver, out)
    if mesh.ranks > 1:
        merged = take(merged, owners(mesh, merged)[0] == mesh.rank)
    if not entering.any() and not leaving.any() and merged.count == 0:
        return points
    return join(
        [take(points, ~entering & ~leaving), _split(solver, np.flatnonzero(entering)), merged]
    )


def _split(solver: Solver, chosen: Ints) -> MaterialPoints:
    """Points on the next finer level in place of those chosen."""
    h, mesh = solver.hierarchy, solver.mesh
    L = solver.velocity_gradient(chosen)
    parents = take(solver.points, chosen)
    whole = parents.half[:, 0] > 0.75 * solver.nominal_half  # strays are small already
    parts = [_relabel(solver, take(parents, ~whole), 1)]
    signs = corners(h.dim)
    big, L = take(parents, whole), L[whole]
    edge = (h.cell / 2.0**big.level)[:, None]
    for sign in signs:
        part = take(big, np.arange(big.count))
        offset = 0.5 * sign * big.half * edge
        moved = np.einsum("nij,nj->ni", big.F, offset)
        part.reference += offset
        part.x += moved
        part.v += np.einsum("nij,nj->ni", L, moved)
        part.mass /= len(signs)
        part.volume /= len(signs)
        part.half *= 0.5
        parts.append(_relabel(solver, part, 1))
    children = join(parts)
    children.id[:] = lattice_id(mesh, children)
    return children


def _merge(solver: Solver, points: MaterialPoints) -> MaterialPoints:
    """One point of the coarser level for every whole family; strays change level alone."""
    if points.count == 0:
        return points
    h, mesh = solver.hierarchy, solver.mesh
    keys = np.column_stack([points.level, family(mesh, points, points.level - 1)])
    _, which, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    which = which.ravel()
    nominal = np.isclose(points.half[:, 0], solver.nominal_half)
    whole = (count[which] == 2**h.dim) & nominal
    edge = h.cell / 2.0 ** (points.level - 1)
    away = np.array(
        [h.distance(int(k), x[None])[0] for k, x in zip(points.level, points.x, strict=True)]
    )
    strays = ~whole & (away > STRAY_AWAY * edge)
    parts = [take(points, ~whole & ~strays), _relabel(solver, take(points, strays), -1)]
    if whole.any():
        family_of = np.unique(which[whole], return_inverse=True)[1]
        parts.append(_relabel(solver, _sum_up(take(points, whole), family_of), -1))
        parts[-1].id[:] = lattice_id(mesh, parts[-1])
    return join(parts)


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
    for name in ("reference", "F"):
        getattr(merged, name)[:] = mean(getattr(parts, name), parts.volume)
    merged.mass[:], merged.volume[:] = total(parts.mass), total(parts.volume)
    merged.half *= 2.0
    return merged


def _relabel(solver: Solver, points: MaterialPoints, up: int) -> MaterialPoints:
    """The same points on a level ``up`` finer: sizes count in its cells, kicks in its steps."""
    out = take(points, np.arange(points.count))
    out.half *= 2.0**up
    out.level += np.int32(up)
    lag = np.array([solver.lag(level) for level in range(solver.top + 1)])
    out.dv *= 0.5**up
    out.v += lag[points.level][:, None] * points.dv - lag[out.level][:, None] * out.dv
    return out

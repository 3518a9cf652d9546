"""Distribution of points: how they fill a mesh, and their rank, block and order in the arrays."""

from __future__ import annotations

from dataclasses import fields
from itertools import product

import numpy as np

from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.points.material_points import (
    Configuration,
    MaterialPoints,
    join,
    points_at_rest,
    take,
)
from gimpmd_gimp.sweeps.threads import STRIPE_ROWS
from gimpmd_schemas.arrays import Float32s, Floats, Int32s, Ints


def fill(mesh: Mesh, per_cell: int, density: float, history: int = 0) -> MaterialPoints:
    """Make material points that tile the rank's patches, ``per_cell`` along each axis of a cell.

    Cells that a finer level covers stay empty, because that level fills them. Parameters are those
    of `points_at_rest`.
    """
    h, parts = mesh.hierarchy, []
    for block in mesh.blocks:
        axes = [
            low + (np.arange((high - low) * per_cell) + 0.5) / per_cell for low, high in block.patch
        ]
        cells = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, h.dim)
        edge = h.edge(block.level)
        reference = np.asarray(h.low) + cells * edge
        if block.level < h.top:
            reference = reference[h.distance(block.level + 1, reference) > 0.0]
        n = reference.shape[0]
        parts.append(
            points_at_rest(
                reference,
                np.full(n, (edge / per_cell) ** h.dim),
                density,
                np.full((n, h.dim), 0.5 / per_cell),
                np.full(n, block.level, dtype=np.int32),
                history=history,
            )
        )
    if not parts:
        nowhere = np.empty((0, h.dim))
        return points_at_rest(
            nowhere, np.empty(0), density, nowhere, np.empty(0, np.int32), history=history
        )
    points = join(parts)
    points.id[:] = lattice_id(mesh, points)
    return points


def lattice_id(mesh: Mesh, points: MaterialPoints) -> Ints:
    """Ids of points, from their level and their place on its lattice of reference positions."""
    h = mesh.hierarchy
    index = family(mesh, points, points.level)
    name = points.level.astype(np.int64)
    for axis in range(h.dim):
        name = name * (16 * h.count(h.top)[axis]) + index[:, axis]
    return name


def family(mesh: Mesh, points: MaterialPoints, level: Int32s) -> Ints:
    """Indices of reference positions on the point lattice of a level, shape ``(n, d)``.

    The ``2^d`` points into which a point splits share one place on the lattice of the next coarser
    level. They are a family.
    """
    h = mesh.hierarchy
    spacing = 2.0 * points.half * (h.cell / 2.0**points.level)[:, None]
    spacing *= (2.0 ** (points.level - level))[:, None]
    place: Ints = np.floor((points.reference - np.asarray(h.low)) / spacing + 1e-9).astype(np.int64)
    return place


def owners(
    mesh: Mesh, points: MaterialPoints, configuration: Configuration = "current"
) -> tuple[Ints, Ints]:
    """Rank and number of the box, on the level of each point, whose patch is nearest to it."""
    rank, box = np.zeros(points.count, np.int64), np.zeros(points.count, np.int64)
    place = points.on_grid(configuration)
    for level in range(mesh.hierarchy.top + 1):
        here = np.flatnonzero(points.level == level)
        rank[here], box[here] = nearest_patch(mesh, level, place[here])
    return rank, box


def nearest_patch(mesh: Mesh, level: int, x: Floats) -> tuple[Ints, Ints]:
    """Rank and number of the box, on a level, whose patch is nearest to each position."""
    h, nearest = mesh.hierarchy, np.full(x.shape[0], np.inf)
    rank, box = np.zeros(x.shape[0], np.int64), np.zeros(x.shape[0], np.int64)
    cells = (x - np.asarray(h.low)) / h.edge(level)
    for number, pieces in enumerate(mesh.patches[level]):
        for piece, patch in enumerate(pieces):
            away = _distance(cells, patch, h.count(level), h.periodic)
            closer = away < nearest
            nearest[closer] = away[closer]
            rank[closer], box[closer] = piece, number
    return rank, box


def _distance(
    cells: Floats, patch: tuple[tuple[int, int], ...], n: Ints, periodic: tuple[bool, ...]
) -> Floats:
    worst = np.zeros(cells.shape[0])
    for axis, (low, high) in enumerate(patch):
        y = cells[:, axis] - 0.5 * (low + high)
        if periodic[axis]:
            y = y - n[axis] * np.round(y / n[axis])
        worst = np.maximum(worst, np.abs(y) - 0.5 * (high - low))
    return worst


def settle(
    mesh: Mesh, points: MaterialPoints, configuration: Configuration = "current"
) -> MaterialPoints:
    """Send points to the ranks whose patches contain them, and set their blocks; collective."""
    rank, box = owners(mesh, points, configuration)
    if mesh.ranks > 1:
        leaving = rank != mesh.rank
        parcels = [
            take(points, rank == other) if other != mesh.rank and (rank == other).any() else None
            for other in range(mesh.ranks)
        ]
        arrived = [parcel for parcel in mesh.comm.alltoall(parcels) if parcel is not None]
        if arrived or leaving.any():
            points = join([take(points, ~leaving), *arrived])
            rank, box = owners(mesh, points, configuration)
    table = np.full((mesh.hierarchy.top + 1, max(len(b) for b in mesh.patches)), -1, dtype=np.int32)
    count = 0
    for level, boxes in enumerate(mesh.patches):
        for number, pieces in enumerate(boxes):
            if mesh.rank < len(pieces):
                table[level, number] = count
                count += 1
    points.block[:] = table[points.level, box]
    return points


def in_blocks(
    mesh: Mesh, points: MaterialPoints, configuration: Configuration = "current"
) -> Floats:
    """Positions in cells of the block of each point, from its first node, shape ``(n, d)``."""
    f = mesh.frames
    y = points.on_grid(configuration) - f.centre[points.block]
    safe = np.where(f.period > 0.0, f.period, 1.0)
    y -= np.where(f.period > 0.0, safe * np.floor(y / safe + 0.5), 0.0)
    cells: Floats = y * f.per_cell[points.block][:, None] + f.middle[points.block]
    return cells


def sort(
    mesh: Mesh, points: MaterialPoints, configuration: Configuration = "current"
) -> tuple[Float32s, Ints]:
    """Sort points in place by stripe and nearest node, the order in which sweeps are fast.

    Returns
    -------
    home : ndarray of float32, shape ``(n, d)``
        Positions in cells of the block of each point, from its first node.
    stripe : ndarray of int64, shape ``(n,)``
        Stripe of each point. Stripes whose numbers have the same parity share no node.
    """
    f, home = mesh.frames, in_blocks(mesh, points, configuration)
    rows = np.floor(home[:, 0]).astype(np.int64) // STRIPE_ROWS
    # each block has an even number of stripes, so that parity depends only on the row
    before = np.concatenate([[0], np.cumsum(2 * (f.shape[:, 0] // (2 * STRIPE_ROWS) + 1))])
    stripe = before[points.block] + np.clip(rows, 0, f.shape[points.block, 0] // STRIPE_ROWS)
    nearest = np.floor(home + 0.5).astype(np.int64)
    keys = [
        points.id,
        *(nearest[:, axis] for axis in reversed(range(points.dim))),
        stripe,
        stripe % 2,
    ]
    order = np.lexsort(keys)
    # one field at a time, so that memory never holds all of them twice
    for field in fields(points):
        setattr(points, field.name, np.ascontiguousarray(getattr(points, field.name)[order]))
    return home[order].astype(np.float32), stripe[order]


def corners(dim: int) -> Floats:
    """Signs of the ``2^d`` corners of a box, shape ``(2^d, d)``."""
    return np.array(list(product((-1.0, 1.0), repeat=dim)))

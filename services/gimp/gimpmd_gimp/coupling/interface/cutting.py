"""Material points that planes cross are cut: at the planes of the interface the continuum ends."""

from __future__ import annotations

import numpy as np

from gimpmd_gimp.points.material_points import MaterialPoints, join, take
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.grid.planes import Interface
from gimpmd_schemas.grid.zones import Box

ROUNDING = 1e-9
"""Cells below which a width is rounding."""

_PIECE = 1 << 60
"""Beyond all ids of whole points; pieces of one point that follow the first count in it."""

SECOND_PIECE = 1 << 57
"""The same for points that second planes cut; there are up to four pieces, or six."""


def cut(points: MaterialPoints, interface: Interface, cell: float) -> MaterialPoints:
    """Points that fill the continuum exactly up to the planes.

    Points wholly among the free atoms are dropped. A point that a plane crosses keeps the part
    of its domain in the continuum; around a corner of the planes that is a slab of full height and
    a rectangle beside it, two points. No piece is merged with another point: thin ones do no harm
    where points stay at rest on the grid, and merging across a node line spoils the patch test.

    Parameters
    ----------
    points : MaterialPoints
        Tile the domain; those at the planes are on the finest level. Ids below 2**60.
    interface : Interface
    cell : float
        Edge of a cell of the finest level (length).

    Returns
    -------
    MaterialPoints
        The first piece of a point keeps its id; those of further pieces follow from it alone, so
        they are the same however the points are spread over ranks.
    """
    return divide(points, interface.planes, cell, _PIECE)[0]


def divide(
    points: MaterialPoints, box: Box, cell: float, piece: int
) -> tuple[MaterialPoints, MaterialPoints]:
    """Points outside and inside a box; those that its faces cross are cut into pieces.

    Parameters
    ----------
    box : Box
        Coordinates of its faces (length), which may be infinite.
    cell : float
        Edge of a cell of the finest level (length).
    piece : int
        What is added to the id of a point for each of its pieces but the first.
    """
    low, high = points.reference - cell * points.half, points.reference + cell * points.half
    core = np.array(box)
    inner = np.maximum(low, core[:, 0]), np.minimum(high, core[:, 1])
    crossed = (inner[1] - inner[0] > ROUNDING * cell).all(axis=1)
    parts, pieces = [take(points, ~crossed)], np.zeros(points.count, dtype=np.int64)
    for axis in range(points.dim):
        for ends in ((low, inner[0]), (inner[1], high)):
            kept = crossed & (ends[1][:, axis] - ends[0][:, axis] > ROUNDING * cell)
            start, end = low.copy(), high.copy()
            start[:, axis], end[:, axis] = ends[0][:, axis], ends[1][:, axis]
            parts.append(_piece(points, kept, start, end, cell, pieces * piece))
            pieces[kept] += 1
        low[:, axis], high[:, axis] = inner[0][:, axis], inner[1][:, axis]
    return join(parts), _piece(points, crossed, low, high, cell, pieces * piece)


def _piece(
    points: MaterialPoints, kept: Bools, start: Floats, end: Floats, cell: float, added: Ints
) -> MaterialPoints:
    """Pieces with domains from ``start`` to ``end`` of the points that are kept."""
    piece = take(points, kept)
    half = 0.5 * (end - start)[kept] / cell
    share = (half / piece.half).prod(axis=1)
    reference = 0.5 * (start + end)[kept]
    piece.x += np.einsum("nij,nj->ni", piece.F, reference - piece.reference)
    piece.reference, piece.half = reference, half
    piece.volume *= share
    piece.mass *= share
    piece.id += added[kept]
    return piece

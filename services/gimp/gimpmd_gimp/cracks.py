"""Traction-free straight cracks: a second velocity field on the nodes near them.

A node that a point cannot see, because the straight line between them crosses the crack, gives
the point its *twin* instead: a node at the same place with a mass, momentum and force of its
own (the multiple velocity fields of Guo and Nairn 2004, without contact). Cracks are fixed in
space, which serves while they open by less than a cell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from gimpmd_schemas.case import Crack, Vector
from gimpmd_schemas.grid import PAD, BackgroundGrid, Floats, Ints


@dataclass(frozen=True)
class Cracks:
    """Crack segments, and the nodes near them with their twins.

    Attributes
    ----------
    segments : ndarray, shape ``(c, 4)``
        x and y of both ends; an end on a face of the domain is carried on beyond it.
    twin : ndarray of int64, shape ``(grid.size,)``
        Id of a node's twin, or -1.
    twins : ndarray of int64, shape ``(t,)``
        The nodes that have one, in the order of their twins.
    """

    segments: Floats
    twin: Ints
    twins: Ints


def make_cracks(cracks: tuple[Crack, ...], grid: BackgroundGrid) -> Cracks:
    """Give every node within reach of a crack (two cells and a half) its twin."""
    segments = np.array(
        [[*_beyond(c.end, c.start, grid), *_beyond(c.start, c.end, grid)] for c in cracks]
    )
    segments = segments.reshape(-1, 4)
    near = np.zeros(grid.size, dtype=np.bool_)
    for segment in segments:
        near |= _distance(grid.positions(), segment) < 2.5 * grid.cell
    twins = np.flatnonzero(near).astype(np.int64)
    twin = np.full(grid.size, -1, dtype=np.int64)
    twin[twins] = grid.size + np.arange(twins.size)
    return Cracks(segments, twin, twins)


def near_cracks(cracks: Cracks, x: Floats, grid: BackgroundGrid) -> Ints:
    """Points at ``x``, shape ``(n, 2)``, whose stencil a crack may cut."""
    near = np.zeros(x.shape[0], dtype=np.bool_)
    for segment in cracks.segments:
        near |= _distance(x, segment) < 2.5 * grid.cell
    return np.flatnonzero(near).astype(np.int64)


def _beyond(start: Vector, end: Vector, grid: BackgroundGrid) -> list[float]:
    """Carry an end that lies on a face straight on, out of the domain, past nodes and points."""
    low = np.array(grid.origin)
    high = low + np.array(grid.cells) * grid.cell
    x, along = np.array(end), np.array(end) - np.array(start)
    on_face = np.minimum(np.abs(x - low), np.abs(x - high)).min() < 1e-9 * grid.cell
    if on_face:
        x = x + 8.0 * grid.cell * along / np.linalg.norm(along)
    return [float(c) for c in x]


def _distance(x: Floats, segment: Floats) -> Floats:
    start, along = segment[:2], segment[2:] - segment[:2]
    t = np.clip((x - start) @ along / (along @ along), 0.0, 1.0)
    return np.asarray(np.linalg.norm(x - start - t[:, None] * along, axis=1))


@njit(cache=True)
def _side(segment: Floats, x: float, y: float) -> bool:
    return (segment[2] - segment[0]) * (y - segment[1]) >= (segment[3] - segment[1]) * (
        x - segment[0]
    )


@njit(cache=True)
def _hidden(segments: Floats, x: Floats, y: Floats) -> bool:
    """Whether any crack crosses the straight line from x to y."""
    for c in range(segments.shape[0]):
        segment = segments[c]
        if _side(segment, x[0], x[1]) == _side(segment, y[0], y[1]):
            continue
        ax, ay = segment[2] - segment[0], segment[3] - segment[1]
        bx, by = y[0] - x[0], y[1] - x[1]
        t = ((x[0] - segment[0]) * by - (x[1] - segment[1]) * bx) / (ax * by - ay * bx)
        if 0.0 <= t <= 1.0:
            return True
    return False


@njit(cache=True)
def fill_detours(
    base: Ints,
    x: Floats,
    columns: int,
    origin: Floats,
    h: float,
    segments: Floats,
    twin: Ints,
    candidates: Ints,
    across: Ints,
    detour: Ints,
) -> None:
    """Nodes of the points near cracks, twins where the crack hides the node.

    Parameters
    ----------
    base, x : ndarray
        First nodes ``(n,)`` and positions ``(n, 2)`` of all points.
    candidates : ndarray of int64, shape ``(m,)``
        Points that may see a crack.
    across : ndarray of int64, shape ``(n,)``
        Set to the row in ``detour`` for points that have a hidden node, else to -1.
    detour : ndarray of int64, shape ``(m, 9)``
        Node ids.
    """
    node = np.empty(2)
    for row in range(candidates.size):
        p = candidates[row]
        across[p] = -1
        for a in range(3):
            for b in range(3):
                i = base[p] + a * columns + b
                node[0] = origin[0] + h * (i // columns - PAD)
                node[1] = origin[1] + h * (i % columns - PAD)
                hidden = twin[i] >= 0 and _hidden(segments, x[p], node)
                detour[row, 3 * a + b] = twin[i] if hidden else i
                if hidden:
                    across[p] = row

"""Traction-free straight cracks: a second velocity field on the nodes near them.

A node that a point cannot see, because the straight line between them crosses the crack, gives
the point its *twin* instead: a node at the same place with a mass, momentum and force of its
own (the multiple velocity fields of Guo and Nairn 2004, without contact). Cracks are fixed in
space, which serves while they open by less than a cell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from gimpmd_gimp.hierarchy import Hierarchy
from gimpmd_gimp.kernels import Stencils
from gimpmd_gimp.mesh import Mesh
from gimpmd_gimp.points import MaterialPoints
from gimpmd_schemas.grid import Bools, Floats, Ints

Point = tuple[float, ...]

NEAR = 2.5
"""Cells within which nodes get twins and points may see a crack."""


HAIR = 1e-6
"""Cells by which a tip is drawn back: a node on which a crack ends stays whole."""


@dataclass(frozen=True)
class Cracks:
    """Straight cracks in two dimensions.

    Attributes
    ----------
    segments : ndarray, shape ``(c, 4)``
        x and y of both ends; an end on a face of the domain is carried on beyond it.
    hierarchy : Hierarchy
    """

    segments: Floats
    hierarchy: Hierarchy

    def doubled(self, level: int, x: Floats) -> Bools:
        """Which nodes of a level, at positions ``(n, 2)``, get a twin."""
        near = np.zeros(x.shape[0], dtype=np.bool_)
        for segment in self.segments:
            near |= _distance(x, segment) < NEAR * self.hierarchy.edge(level)
        return near


def make_cracks(cracks: Sequence[tuple[Point, Point]], hierarchy: Hierarchy) -> Cracks | None:
    """Cracks between given ends; None without any."""
    if not cracks:
        return None
    ends = [end for pair in cracks for end in pair]
    joints = {end for end in ends if ends.count(end) > 1}
    segments = [
        [*_outer(b, a, joints, hierarchy), *_outer(a, b, joints, hierarchy)] for a, b in cracks
    ]
    return Cracks(np.array(segments).reshape(-1, 4), hierarchy)


def near_cracks(cracks: Cracks | None, points: MaterialPoints, hierarchy: Hierarchy) -> Ints:
    """Points whose stencil a crack may cut."""
    near = np.zeros(points.count, dtype=np.bool_)
    if cracks is not None:
        edge = hierarchy.cell / 2.0**points.level
        for segment in cracks.segments:
            near |= _distance(points.x, segment) < NEAR * edge
    return np.flatnonzero(near).astype(np.int64)


def fill_detours(
    cracks: Cracks, mesh: Mesh, points: MaterialPoints, candidates: Ints, stencils: Stencils
) -> None:
    """Name the nodes of points near cracks, twins where the crack hides the node.

    Parameters
    ----------
    candidates : ndarray of int64, shape ``(m,)``
        Points that may see a crack.
    """
    positions = mesh.positions()
    s = stencils
    _fill_detours(
        s.base,
        s.block,
        s.strides,
        points.x,
        positions,
        cracks.segments,
        mesh.twin,
        candidates,
        s.across,
        s.detour,
    )


def _outer(start: Point, end: Point, joints: set[Point], hierarchy: Hierarchy) -> list[float]:
    """Where the crack from ``start`` ends on the grid.

    An end on a face goes straight on, out of the domain, past nodes and points. A tip, an end that
    no other crack shares, is drawn back: were the node on it split, the crack would be longer by a
    cell.
    """
    low = np.array(hierarchy.low)
    high = low + np.array(hierarchy.cells) * hierarchy.cell
    x, along = np.array(end), np.array(end) - np.array(start)
    on_face = np.minimum(np.abs(x - low), np.abs(x - high)).min() < 1e-9 * hierarchy.cell
    cells = 8.0 if on_face else 0.0 if end in joints else -HAIR
    x = x + cells * hierarchy.cell * along / np.linalg.norm(along)
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
def _fill_detours(
    base: Ints,
    block: Ints,
    strides: Ints,
    x: Floats,
    positions: Floats,
    segments: Floats,
    twin: Ints,
    candidates: Ints,
    across: Ints,
    detour: Ints,
) -> None:
    for row in range(candidates.size):
        p = candidates[row]
        across[p] = -1
        for a in range(3):
            for b in range(3):
                i = base[p] + a * strides[block[p], 0] + b
                hidden = twin[i] >= 0 and _hidden(segments, x[p], positions[i])
                detour[row, 3 * a + b] = twin[i] if hidden else i
                if hidden:
                    across[p] = row

"""Points along a face of the domain, and forces spread over their outer faces."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gimpmd_gimp.points.body import Body
from gimpmd_gimp.sweeps import kernels
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.face_parts import in_part
from gimpmd_schemas.grid.zones import Box


def outermost_points(body: Body, axis: int, side: int, region: Box | None = None) -> Ints:
    """Points whose outer face lies on a face of the domain, by reference positions, ascending.

    With a region (`FacePart.region`) only those of a part of the face.
    """
    h, p = body.hierarchy, body.points
    size = p.half * (h.cell / 2.0**p.level)[:, None]
    face = h.low[axis] + (h.cells[axis] * h.cell if side else 0.0)
    outermost = np.abs(p.reference[:, axis] - face) < 2.0 * size[:, axis]
    return np.flatnonzero(outermost & in_part(region, p.reference))


class FaceLoad:
    """A force per area on the outer faces of one level's points along a domain face.

    The force acts on the face that a point turns outward, where the point stands on the grid: it
    follows the point in the current configuration. Hat functions share the force between nodes
    across the face, so a face on a line of nodes loads only that line.

    Parameters
    ----------
    body : Body
    axis, side : int
        The face of the domain; side 0 is the lower one.
    value : ndarray, shape ``(d,)`` or ``(n, d)``
        Force per area (per length in two dimensions) of all points or of each, mechanical units.
    level : int
    chosen : ndarray of int64
        The points.
    """

    def __init__(
        self,
        body: Body,
        axis: int,
        side: int,
        value: Floats,
        level: int,
        chosen: Ints,
    ) -> None:
        self.level = level
        self._body, self._axis, self._side, self._value = body, axis, side, value
        self._chosen = chosen
        levels, place = body.points.level[chosen], body.place[chosen]
        self._near_cracks = body.cut_candidates(levels, place)
        self._stencils = kernels.make_stencils(
            body.points.block[chosen], body.mesh.frames, self._near_cracks.size
        )
        self._at_rest: tuple[Ints, Floats] | None = None

    def add(self, share: float, J: Floats) -> None:
        """Add ``share`` times the nodal force to ``J``, shape ``(size, d)``."""
        if not self._body.total_lagrangian:
            self._scatter(share, J)
            return
        if self._at_rest is None:  # nodes and forces never change
            whole = np.zeros_like(J)
            self._scatter(1.0, whole)
            nodes = np.flatnonzero(whole.any(axis=1))
            self._at_rest = nodes, whole[nodes]
        nodes, force = self._at_rest
        J[nodes] += share * force

    def _scatter(self, share: float, J: Floats) -> None:
        body, chosen, axis = self._body, self._chosen, self._axis
        points, mesh = body.points, body.mesh
        half = points.half[chosen].copy()
        if body.stretched:
            half *= np.einsum("nkk->nk", points.F[chosen])
        length = 2.0 * half * mesh.hierarchy.edge(self.level)
        face = body.place[chosen]
        face[:, axis] += (0.5 if self._side else -0.5) * length[:, axis]
        half[:, axis] = kernels.HAT
        area = np.prod(np.delete(length, axis, axis=1), axis=1)
        load = share * np.broadcast_to(self._value, (chosen.size, points.dim))
        order, n = np.arange(chosen.size), chosen.size
        home = np.zeros(face.shape, dtype=np.float32)
        identity = np.tile(np.eye(points.dim), (n, 1, 1))
        s = self._stencils
        kernels.fill_stencils(
            order, 0, n, s, mesh.frames, kernels.GIMP, False, face, half, identity, home
        )
        if body.cracks is not None:
            reference = points.reference[chosen]
            body.cracks.fill_detours(mesh, reference, face, self._near_cracks, s)
        kernels.scatter_vector(order, 0, n, s, area, load, J)


FaceValue = tuple[float, ...] | Callable[[Floats], Floats]
"""Force per area: components, or a function of reference positions ``(n, d)``."""


def find_face_loads(
    body: Body, axis: int, side: int, value: FaceValue, region: Box | None = None
) -> list[FaceLoad]:
    """Loads on the points along a face of the domain, one for each level that has some.

    Parameters
    ----------
    value : tuple of float or callable
        Force per area: components, or a function that gives them, ``(n, d)``, at reference
        positions ``(n, d)``.
    region : Box, optional
        The part of the face that is loaded; see `FacePart.region`. None: all of the face.
    """
    outermost = outermost_points(body, axis, side, region)
    level, loads = body.points.level[outermost], list[FaceLoad]()
    for one in np.unique(level):
        chosen = outermost[level == one]
        full = value(body.points.reference[chosen]) if callable(value) else np.array(value)
        loads.append(FaceLoad(body, axis, side, full, int(one), chosen))
    return loads

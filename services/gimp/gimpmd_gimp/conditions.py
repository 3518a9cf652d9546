"""Conditions on the body: tractions on particle faces, driven nodes, body forces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gimpmd_gimp import kernels
from gimpmd_gimp.mesh import Mesh
from gimpmd_gimp.points import MaterialPoints
from gimpmd_schemas.grid import Floats, Ints

BodyForce = Callable[[Floats, float], Floats]
"""Acceleration ``b(X, t)``, shape ``(n, d)``, at reference positions ``(n, d)``."""

TimeFunction = Callable[[float], float]


@dataclass(frozen=True)
class Traction:
    """A traction on a face of the domain.

    Attributes
    ----------
    axis, side : the face; side 0 is the lower one.
    value : force per area (length in two dimensions) along each axis, mechanical units.
    factor : share of it that acts at a time.
    """

    axis: int
    side: int
    value: tuple[float, ...]
    factor: TimeFunction


@dataclass(frozen=True)
class Driven:
    """A prescribed velocity component on a face of the domain.

    Attributes
    ----------
    axis, side : the face.
    component : axis of the velocity component.
    velocity : its value over time.
    """

    axis: int
    side: int
    component: int
    velocity: TimeFunction


@dataclass(frozen=True)
class HeldNodes:
    """Nodes of one level on and beyond a driven face."""

    level: int
    component: int
    velocity: TimeFunction
    nodes: Ints


@dataclass
class Load:
    """A traction on the outer faces of one level's points along a face of the domain.

    The load acts on the face that a point turns outward and follows it as it moves; across the
    face it is shared by hat functions, so a face on a line of nodes loads that line.
    """

    traction: Traction
    level: int
    points: Ints
    mesh: Mesh
    stencils: kernels.Stencils

    def factor(self, time: float) -> float:
        """Share of the traction that acts at a time."""
        return self.traction.factor(time)

    def add(self, points: MaterialPoints, stretch: bool, share: float, J: Floats) -> None:
        """Add ``share`` of the nodal force of the full traction to ``J``, shape ``(size, d)``.

        Points have the size they have in the weights: stretched by F, or not.
        """
        chosen, axis = self.points, self.traction.axis
        half = points.half[chosen].copy()
        if stretch:
            half *= np.einsum("nkk->nk", points.F[chosen])
        length = 2.0 * half * self.mesh.hierarchy.edge(self.level)
        face = points.x[chosen].copy()
        face[:, axis] += (0.5 if self.traction.side else -0.5) * length[:, axis]
        half[:, axis] = kernels.HAT
        area = np.prod(np.delete(length, axis, axis=1), axis=1)
        load = share * np.tile(self.traction.value, (chosen.size, 1))
        order, n = np.arange(chosen.size), chosen.size
        home = np.zeros_like(face)
        identity = np.tile(np.eye(points.dim), (n, 1, 1))
        frames = self.mesh.frames
        kernels.fill_stencils(
            order, 0, n, self.stencils, frames, kernels.GIMP, False, face, half, identity, home
        )
        kernels.scatter_vector(order, 0, n, self.stencils, area, load, J)


def make_loads(tractions: Sequence[Traction], mesh: Mesh, points: MaterialPoints) -> list[Load]:
    """Find the points that carry each traction: those whose face lies on the domain's."""
    h, loads = mesh.hierarchy, []
    size = points.half * (h.cell / 2.0**points.level)[:, None]
    for traction in tractions:
        axis = traction.axis
        rim = h.low[axis] + (h.cells[axis] * h.cell if traction.side else 0.0)
        outermost = np.abs(points.reference[:, axis] - rim) < 2.0 * size[:, axis]
        for level in np.unique(points.level[outermost]):
            chosen = np.flatnonzero(outermost & (points.level == level))
            n, d = chosen.size, points.dim
            stencils = kernels.Stencils(
                axes=(0,) * d,
                base=np.zeros(n, dtype=np.int64),
                w=np.zeros((n, 2, d)),
                g=np.zeros((n, 2, d)),
                block=points.block[chosen],
                strides=mesh.frames.strides,
                across=np.full(n, -1, dtype=np.int64),
                detour=np.zeros((1, 3**d), dtype=np.int64),
            )
            loads.append(Load(traction, int(level), chosen, mesh, stencils))
    return loads


def hold_nodes(mesh: Mesh, driven: Sequence[Driven]) -> list[HeldNodes]:
    """Nodes of the basis on and beyond each driven face, level by level."""
    h, held = mesh.hierarchy, []
    for one in driven:
        for level in range(h.top + 1):
            along = mesh.coords[:, one.axis]
            beyond = along >= h.count(level)[one.axis] if one.side else along <= 0
            nodes = np.flatnonzero(beyond & mesh.basis & (mesh.level == level))
            if nodes.size:
                held.append(HeldNodes(level, one.component, one.velocity, nodes))
    return held

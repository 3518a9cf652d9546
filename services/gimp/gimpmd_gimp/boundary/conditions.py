"""Conditions on the body: tractions on particle faces, driven nodes, body forces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from gimpmd_gimp.fracture.cracks import Cracks, fill_detours, near_cracks
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.points.material_points import Configuration, MaterialPoints
from gimpmd_gimp.sweeps import kernels
from gimpmd_schemas.arrays import Floats, Ints

BodyForce = Callable[[Floats, float], Floats]
"""Acceleration ``b(X, t)``, shape ``(n, d)``, at reference positions ``(n, d)``."""

TimeFunction = Callable[[float], float]


class NodalForces(Protocol):
    """Forces that act on nodes of the finest level, as those of atoms that hang on the grid."""

    def add(self, span: float, J: Floats) -> None:
        """Add their impulse over a span of time to nodal sums ``J``, shape ``(size, d)``.

        This rank's part: what ranks give to a node that they share is added up afterwards.
        """
        ...


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
class Displaced:
    """A prescribed displacement component on a face of the domain, exact at every step.

    Attributes
    ----------
    axis, side : the face.
    component : axis of the displacement component.
    displacement : its value over time; asked for times from one step before the start.
    """

    axis: int
    side: int
    component: int
    displacement: TimeFunction


@dataclass(frozen=True)
class HeldNodes:
    """Nodes of one level on and beyond a driven face.

    Attributes
    ----------
    velocity : at the time of the nodal velocities.
    during : velocity all through a step, if the steps are to add up to a given displacement: from
        the time of the nodal velocities, and whether the step's kick is behind them.
    """

    level: int
    component: int
    nodes: Ints
    velocity: TimeFunction
    during: Callable[[float, bool], float] | None = None

    def hold(self, V: Floats, clock: float, kicked: bool, share: float = 1.0) -> None:
        """Set the nodal velocity, in place, to a share of what is prescribed."""
        value = self.velocity(clock) if self.during is None else self.during(clock, kicked)
        V[self.nodes, self.component] = share * value


@dataclass(frozen=True)
class Pace:
    """How points move with the nodal velocities of a level.

    Attributes
    ----------
    dt : time step.
    at : where in the step the velocities that move points stand: in its middle, at its end, or
        at both ends, whose mean counts.
    """

    dt: float
    at: Literal["middle", "end", "ends"]


@dataclass
class Load:
    """A traction on the outer faces of one level's points along a face of the domain.

    The load acts on the face that a point turns outward, where the point stands on the grid: it
    follows the point as it moves, or stays at rest. Across the face it is shared by hat functions,
    so a face on a line of nodes loads that line.
    """

    traction: Traction
    level: int
    points: Ints
    mesh: Mesh
    stencils: kernels.Stencils
    cracks: Cracks | None
    near: Ints
    configuration: Configuration
    _fixed: tuple[Ints, Floats] | None = None

    def factor(self, time: float) -> float:
        """Share of the traction that acts at a time."""
        return self.traction.factor(time)

    def add(self, points: MaterialPoints, stretch: bool, share: float, J: Floats) -> None:
        """Add ``share`` of the nodal force of the full traction to ``J``, shape ``(size, d)``.

        Points have the size they have in the weights: stretched by F, or not.
        """
        if self.configuration == "current":
            self._scatter(points, stretch, share, J)
            return
        nodes, force = self._at_rest(points, J)
        J[nodes] += share * force

    def _at_rest(self, points: MaterialPoints, like: Floats) -> tuple[Ints, Floats]:
        """Nodes and nodal forces of the full traction, which stay as they are."""
        if self._fixed is None:
            J = np.zeros_like(like)
            self._scatter(points, False, 1.0, J)
            nodes = np.flatnonzero(J.any(axis=1))
            self._fixed = nodes, J[nodes]
        return self._fixed

    def _scatter(self, points: MaterialPoints, stretch: bool, share: float, J: Floats) -> None:
        chosen, axis = self.points, self.traction.axis
        half = points.half[chosen].copy()
        if stretch:
            half *= np.einsum("nkk->nk", points.F[chosen])
        length = 2.0 * half * self.mesh.hierarchy.edge(self.level)
        face = points.on_grid(self.configuration)[chosen]
        face[:, axis] += (0.5 if self.traction.side else -0.5) * length[:, axis]
        half[:, axis] = kernels.HAT
        area = np.prod(np.delete(length, axis, axis=1), axis=1)
        load = share * np.tile(self.traction.value, (chosen.size, 1))
        order, n = np.arange(chosen.size), chosen.size
        home = np.zeros(face.shape, dtype=np.float32)
        identity = np.tile(np.eye(points.dim), (n, 1, 1))
        frames = self.mesh.frames
        kernels.fill_stencils(
            order, 0, n, self.stencils, frames, kernels.GIMP, False, face, half, identity, home
        )
        if self.cracks is not None:
            reference = points.reference[chosen]
            fill_detours(self.cracks, self.mesh, reference, face, self.near, self.stencils)
        kernels.scatter_vector(order, 0, n, self.stencils, area, load, J)


def make_loads(
    tractions: Sequence[Traction],
    mesh: Mesh,
    points: MaterialPoints,
    cracks: Cracks | None = None,
    configuration: Configuration = "current",
) -> list[Load]:
    """Find the points that carry each traction: those whose face lies on the domain's."""
    h, loads, place = mesh.hierarchy, [], points.on_grid(configuration)
    size = points.half * (h.cell / 2.0**points.level)[:, None]
    for traction in tractions:
        axis = traction.axis
        rim = h.low[axis] + (h.cells[axis] * h.cell if traction.side else 0.0)
        outermost = np.abs(points.reference[:, axis] - rim) < 2.0 * size[:, axis]
        for level in np.unique(points.level[outermost]):
            chosen = np.flatnonzero(outermost & (points.level == level))
            near = near_cracks(cracks, points.level[chosen], place[chosen], h)
            stencils = kernels.make_stencils(points.block[chosen], mesh.frames, near.size)
            where = (chosen, mesh, stencils, cracks, near, configuration)
            loads.append(Load(traction, int(level), *where))
    return loads


def hold_nodes(
    mesh: Mesh, driven: Sequence[Driven | Displaced], paces: Sequence[Pace]
) -> list[HeldNodes]:
    """Nodes of the basis on and beyond each driven face, level by level.

    Parameters
    ----------
    paces : sequence of Pace
        One for each level.
    """
    h, held = mesh.hierarchy, []
    for one in driven:
        for level in range(h.top + 1):
            along = mesh.coords[:, one.axis]
            beyond = along >= h.count(level)[one.axis] if one.side else along <= 0
            nodes = np.flatnonzero(beyond & mesh.basis & (mesh.level == level))
            if not nodes.size:
                continue
            if isinstance(one, Driven):
                held.append(HeldNodes(level, one.component, nodes, one.velocity))
            else:
                rates = exact_rates(one.displacement, paces[level])
                held.append(HeldNodes(level, one.component, nodes, *rates))
    return held


def exact_rates(u: TimeFunction, pace: Pace) -> tuple[TimeFunction, Callable[[float, bool], float]]:
    """Velocities that add up to a displacement: as ``HeldNodes`` wants them."""
    dt = pace.dt

    def between(start: float) -> float:
        return (u(start + dt) - u(start)) / dt

    if pace.at == "middle":
        return lambda t: between(t - 0.5 * dt), lambda t, _: between(t - 0.5 * dt)
    if pace.at == "end":
        return lambda t: between(t - dt), lambda t, _: between(t - dt)
    return (
        lambda t: 0.5 * (between(t - dt) + between(t)),
        lambda t, kicked: between(t - dt if kicked else t),
    )

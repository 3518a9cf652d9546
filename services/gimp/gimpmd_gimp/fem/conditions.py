"""Conditions on the faces of the domain: tractions, and prescribed motions of nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimpmd_gimp.coupling.interface.weights import hats
from gimpmd_gimp.points.material_points import MaterialPoints
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.face_parts import FacePart
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.mechanics.units import UNITS

TRACTIONS = ("traction",)
MOTIONS = ("velocity", "displacement", "symmetry")

ON_FACE = 1e-6
"""Distance from a face, in cells, that is rounding."""


@dataclass(frozen=True, eq=False)
class Traction:
    """Forces on nodes, in proportion to a function of time.

    Attributes
    ----------
    part : FacePart
    force : ndarray, shape ``(nodes, d)``
        At the full value (mechanical units).
    """

    part: FacePart
    force: Floats

    def impulse(self, time: float, span: float) -> Floats:
        """Impulse ``(nodes, d)`` over a span of time about ``time``."""
        return span * self.part.condition.factor(time) * self.force


@dataclass(frozen=True, eq=False)
class Motion:
    """A velocity component that some nodes have.

    Attributes
    ----------
    part : FacePart
    component : int
    nodes : ndarray of int64, shape ``(n,)``
    value : ndarray, shape ``(n,)``
        Full value of the velocity or the displacement.
    """

    part: FacePart
    component: int
    nodes: Ints
    value: Floats

    def velocity(self, time: float, dt: float) -> Floats:
        """Velocity ``(n,)`` in the step from ``time`` to ``time + dt``."""
        condition = self.part.condition
        if condition.condition == "displacement":
            rise = condition.factor(time + dt) - condition.factor(time)
            return rise / dt * self.value
        return condition.factor(time + 0.5 * dt) * self.value


def make_conditions(
    plan: Plan, grid: BackgroundGrid, boxes: MaterialPoints, mass: Floats
) -> tuple[list[Traction], list[Motion]]:
    """Conditions of a plan.

    Parameters
    ----------
    plan : Plan
    grid : BackgroundGrid
    boxes : MaterialPoints
        They fill the continuum.
    mass : ndarray, shape ``(nodes,)``
        Masses; nodes without mass belong to the atoms.

    Raises
    ------
    BackendError
        A condition is not known to finite elements.
    """
    tractions, motions = list[Traction](), list[Motion]()
    for part in plan.face_parts():
        name = part.condition.condition
        if name in TRACTIONS:
            tractions.append(_traction(plan, part, grid, boxes))
        elif name in MOTIONS:
            motions += _motions(part, grid, mass)
        else:
            raise BackendError(
                f"{part.key}.condition = {name!r}: continuum.backend: fem knows "
                f"{', '.join(TRACTIONS + MOTIONS)} and free faces; use one of these, or "
                "continuum.backend: gimp"
            )
    return tractions, motions


def _traction(plan: Plan, part: FacePart, grid: BackgroundGrid, boxes: MaterialPoints) -> Traction:
    """Shares of the nodes in the force on the outer faces of the boxes.

    A shape function at the centre of such a face is its mean over it.
    """
    axis, low = part.axis, np.array(grid.origin)
    place = low[axis] + part.side * grid.cells[axis] * grid.cell
    outer = boxes.reference[:, axis] + (2 * part.side - 1) * grid.cell * boxes.half[:, axis]
    chosen = (np.abs(outer - place) < ON_FACE * grid.cell) & part.covers(boxes.reference)
    x, half = boxes.reference[chosen], np.delete(boxes.half[chosen], axis, axis=1)
    x[:, axis] = place
    area = (2.0 * grid.cell * half).prod(axis=1)
    value = UNITS[plan.units].stress_to_mechanical(1.0) * part.value(x)
    return Traction(part, np.asarray(hats(grid, x).T @ (area[:, None] * value)))


def _motions(part: FacePart, grid: BackgroundGrid, mass: Floats) -> list[Motion]:
    x, axis = grid.positions(), part.axis
    place = grid.origin[axis] + part.side * grid.cells[axis] * grid.cell
    on_face = np.abs(x[:, axis] - place) < ON_FACE * grid.cell
    nodes = np.flatnonzero(on_face & part.covers(x) & (mass > 0.0))
    given = part.condition.condition != "symmetry"
    values = part.value(x[nodes]) if given else np.zeros((nodes.size, grid.dim))
    return [
        Motion(part, component, nodes, values[:, component])
        for component, value in enumerate(part.components)
        if value is not None
    ]

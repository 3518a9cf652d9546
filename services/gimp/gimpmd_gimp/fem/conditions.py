"""Conditions on the faces of the domain: tractions, and prescribed motions of nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimpmd_gimp.fem.body import Body
from gimpmd_gimp.fem.face_points import ON_FACE
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.face_parts import FacePart
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.mechanics.units import UNITS

TRACTIONS = ("traction",)
MOTIONS = ("velocity", "displacement", "symmetry")


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


def make_conditions(plan: Plan, body: Body, mass: Floats) -> tuple[list[Traction], list[Motion]]:
    """Conditions of a plan.

    Parameters
    ----------
    plan : Plan
    body : Body
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
            tractions.append(_traction(plan, part, body))
        elif name in MOTIONS:
            motions += _motions(plan, part, body, mass)
        else:
            raise BackendError(
                f"{part.key}.condition = {name!r}: continuum.backend: fem knows "
                f"{', '.join(TRACTIONS + MOTIONS)} and free faces; use one of these, or "
                "continuum.backend: gimp"
            )
    return tractions, motions


def _traction(plan: Plan, part: FacePart, body: Body) -> Traction:
    """Shares of the nodes in the force on a part of a face."""
    points = body.face_points(part.axis, part.side)
    chosen = part.covers(points.x)
    x, area, values = points.x[chosen], points.area[chosen], points.values[chosen]
    value = UNITS[plan.units].stress_to_mechanical(1.0) * part.value(x)
    return Traction(part, np.asarray(values.T @ (area[:, None] * value)))


def _motions(plan: Plan, part: FacePart, body: Body, mass: Floats) -> list[Motion]:
    x = body.nodes
    nodes = np.flatnonzero(part.holds(x, ON_FACE * plan.finest_cell) & (mass > 0.0))
    given = part.condition.condition != "symmetry"
    values = part.value(x[nodes]) if given else np.zeros((nodes.size, plan.dim))
    return [
        Motion(part, component, nodes, values[:, component])
        for component, value in enumerate(part.components)
        if value is not None
    ]

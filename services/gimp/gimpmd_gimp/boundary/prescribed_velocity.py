"""A prescribed velocity component on a face of the domain."""

from __future__ import annotations

from collections.abc import Callable

from gimpmd_gimp.boundary.condition import Condition, ConditionMakers
from gimpmd_gimp.boundary.prescribed import Prescribed, components
from gimpmd_schemas.case.conditions import Face
from gimpmd_schemas.mechanics.units import Units


class PrescribedVelocity(Prescribed):
    """A prescribed velocity component on a face of the domain.

    Parameters
    ----------
    axis, side : int
        The face; side 0 is the lower one.
    component : int
        Axis of the velocity component.
    velocity : callable
        Its value over time.
    """

    def __init__(
        self, axis: int, side: int, component: int, velocity: Callable[[float], float]
    ) -> None:
        super().__init__(axis, side, component)
        self._velocity = velocity

    def velocity(self, level: int, time: float) -> float:
        """See ``Prescribed``."""
        return self._velocity(time)


def from_face(axis: int, side: int, face: Face, units: Units) -> list[Condition]:
    """Make the condition ``velocity`` of a case file: one for each component that is given."""
    return [PrescribedVelocity(axis, side, i, value) for i, value in components(face)]


def symmetry(axis: int, side: int, face: Face, units: Units) -> list[Condition]:
    """Make the condition ``symmetry`` of a case file: no velocity along the normal."""
    return [PrescribedVelocity(axis, side, axis, lambda _: 0.0)]


FACE_CONDITIONS: ConditionMakers = {"velocity": from_face, "symmetry": symmetry}

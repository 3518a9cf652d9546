"""A prescribed velocity component on a face of the domain."""

from __future__ import annotations

from gimpmd_gimp.boundary.condition import Condition, ConditionMakers
from gimpmd_gimp.boundary.prescribed import Prescribed, components
from gimpmd_schemas.case.conditions import Face
from gimpmd_schemas.mechanics.units import Units


class PrescribedVelocity(Prescribed):
    """A prescribed velocity component; see ``Prescribed``."""

    def velocity(self, level: int, time: float) -> float:
        """See ``Prescribed``."""
        return self._value(time)


def from_face(axis: int, side: int, face: Face, units: Units) -> list[Condition]:
    """Make the condition ``velocity`` of a case file: one for each component that is given."""
    return [PrescribedVelocity(axis, side, i, value) for i, value in components(face)]


def symmetry(axis: int, side: int, face: Face, units: Units) -> list[Condition]:
    """Make the condition ``symmetry`` of a case file: no velocity along the normal."""
    return [PrescribedVelocity(axis, side, axis, lambda _: 0.0)]


FACE_CONDITIONS: ConditionMakers = {"velocity": from_face, "symmetry": symmetry}

"""A prescribed velocity component on a face of the domain."""

from __future__ import annotations

from gimpmd_gimp.boundary.condition import Condition, ConditionMakers
from gimpmd_gimp.boundary.prescribed import Prescribed, driven
from gimpmd_schemas.case.face_parts import FacePart
from gimpmd_schemas.mechanics.units import Units


class PrescribedVelocity(Prescribed):
    """A prescribed velocity component; see ``Prescribed``."""

    def velocity(self, level: int, time: float) -> float:
        """See ``Prescribed``."""
        return self._value(time)


def from_face(part: FacePart, units: Units) -> list[Condition]:
    """Make the condition ``velocity`` of a case file: one for each component that is given."""
    return [
        PrescribedVelocity(part.axis, part.side, i, value, part.region, shape)
        for i, value, shape in driven(part)
    ]


def symmetry(part: FacePart, units: Units) -> list[Condition]:
    """Make the condition ``symmetry`` of a case file: no velocity along the normal."""
    return [PrescribedVelocity(part.axis, part.side, part.axis, lambda _: 0.0, part.region)]


FACE_CONDITIONS: ConditionMakers = {"velocity": from_face, "symmetry": symmetry}

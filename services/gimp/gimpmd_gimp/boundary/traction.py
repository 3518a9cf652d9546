"""A traction on a face of the domain."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

from gimpmd_gimp.boundary.condition import Condition, ConditionMakers, Kick
from gimpmd_gimp.boundary.face import FaceLoad, FaceValue, find_face_loads
from gimpmd_schemas.case.face_parts import FacePart
from gimpmd_schemas.grid.zones import Box
from gimpmd_schemas.mechanics.units import Units


class Traction(Condition):
    """A force per area on a face of the domain: ``f_i = int N_i t dA``.

    Parameters
    ----------
    axis, side : int
        The face; side 0 is the lower one.
    value : tuple of float or callable
        Force per area (per length in two dimensions) along each axis, mechanical units; or a
        function that gives it at reference positions, see `find_face_loads`.
    factor : callable
        Fraction of the traction that acts at a time.
    region : Box, optional
        The part of the face, see `FacePart.region`. None: all of the face.
    """

    external: ClassVar[bool] = True

    def __init__(
        self,
        axis: int,
        side: int,
        value: FaceValue,
        factor: Callable[[float], float],
        region: Box | None = None,
    ) -> None:
        self._face, self._factor = (axis, side, value, region), factor
        self._loads: list[FaceLoad] = []

    def regroup(self) -> None:
        """See ``Condition``."""
        self._loads = find_face_loads(self.body, *self._face)

    def add_impulse(self, kick: Kick, level: int) -> None:
        """See ``Condition``."""
        for load in self._loads:
            if load.level == level:
                load.add(kick.span[level] * self._factor(kick.time), self.nodes.loads)


def from_face(part: FacePart, units: Units) -> list[Condition]:
    """Make the condition ``traction`` of a case file."""
    given, value = part.condition.value, _in_mechanical_units(part, units)
    if isinstance(given, tuple):  # the same everywhere
        value = tuple(units.stress_to_mechanical(v or 0.0) for v in given)
    return [Traction(part.axis, part.side, value, part.condition.factor, part.region)]


def _in_mechanical_units(part: FacePart, units: Units) -> FaceValue:
    return lambda x: units.stress_to_mechanical(1.0) * part.value(x)


FACE_CONDITIONS: ConditionMakers = {"traction": from_face}

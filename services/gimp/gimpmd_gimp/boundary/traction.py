"""A traction on a face of the domain."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

from gimpmd_gimp.boundary.condition import Condition, ConditionMakers, Kick
from gimpmd_gimp.boundary.face import FaceLoad, find_face_loads
from gimpmd_schemas.case.conditions import Face
from gimpmd_schemas.mechanics.units import Units


class Traction(Condition):
    """A force per area on a face of the domain: ``f_i = int N_i t dA``.

    Parameters
    ----------
    axis, side : int
        The face; side 0 is the lower one.
    value : tuple of float
        Force per area (per length in two dimensions) along each axis, mechanical units.
    factor : callable
        Fraction of the traction that acts at a time.
    """

    external: ClassVar[bool] = True

    def __init__(
        self, axis: int, side: int, value: tuple[float, ...], factor: Callable[[float], float]
    ) -> None:
        self._face, self._factor = (axis, side, value), factor
        self._loads: list[FaceLoad] = []

    def regroup(self) -> None:
        """See ``Condition``."""
        self._loads = find_face_loads(self.body, *self._face)

    def add_impulse(self, kick: Kick, level: int) -> None:
        """See ``Condition``."""
        for load in self._loads:
            if load.level == level:
                load.add(kick.span[level] * self._factor(kick.time), self.nodes.loads)


def from_face(axis: int, side: int, face: Face, units: Units) -> list[Condition]:
    """Make the condition ``traction`` of a case file."""
    value = tuple(units.stress_to_mechanical(v or 0.0) for v in face.value)
    return [Traction(axis, side, value, face.factor)]


FACE_CONDITIONS: ConditionMakers = {"free": lambda *_: [], "traction": from_face}

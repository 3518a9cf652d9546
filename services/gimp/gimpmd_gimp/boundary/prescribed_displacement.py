"""A prescribed displacement component on a face of the domain, exact at every step."""

from __future__ import annotations

from gimpmd_gimp.boundary.condition import Condition, ConditionMakers
from gimpmd_gimp.boundary.prescribed import Prescribed, driven
from gimpmd_schemas.case.face_parts import FacePart
from gimpmd_schemas.mechanics.units import Units


class PrescribedDisplacement(Prescribed):
    """A prescribed displacement component: velocities that add up to it exactly.

    Its value is asked for times from one step before the start; see ``Prescribed``.
    """

    def velocity(self, level: int, time: float) -> float:
        """Velocity at the middle or the end of a step, or the mean about it; see ``Prescribed``."""
        dt, where = self.clock.dt_of(level), self.clock.moving_velocity_at(level)
        if where == "middle":
            return self._mean(level, time - 0.5 * dt)
        if where == "end":
            return self._mean(level, time - dt)
        return 0.5 * (self._mean(level, time - dt) + self._mean(level, time))

    def moving_velocity(self, level: int, time: float, kicked: bool) -> float:
        """See ``Prescribed``."""
        if self.clock.moving_velocity_at(level) == "both ends":
            return self._mean(level, time - self.clock.dt_of(level) if kicked else time)
        return self.velocity(level, time)

    def constrain_motion(self) -> None:
        """See ``Condition``."""
        for level, place in self._places():
            time = self.clock.velocity_time[level]
            self.nodes.V[place] = self._scale[level] * self.moving_velocity(level, time, True)

    def _mean(self, level: int, start: float) -> float:
        """Mean velocity of the step of a level that starts at a time."""
        dt, u = self.clock.dt_of(level), self._value
        return (u(start + dt) - u(start)) / dt


def from_face(part: FacePart, units: Units) -> list[Condition]:
    """Make the condition ``displacement`` of a case file: one for each component that is given."""
    return [
        PrescribedDisplacement(part.axis, part.side, i, value, part.region, shape)
        for i, value, shape in driven(part)
    ]


FACE_CONDITIONS: ConditionMakers = {"displacement": from_face}

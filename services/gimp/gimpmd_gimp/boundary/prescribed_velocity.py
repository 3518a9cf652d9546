"""A prescribed velocity component on a face of the domain."""

from __future__ import annotations

from collections.abc import Callable

from gimpmd_gimp.boundary.prescribed import Prescribed


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

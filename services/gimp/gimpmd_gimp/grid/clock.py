"""Time of every level: when its velocities are known, and how long its kicks last.

Levels step at different rates (``subcycling.py``), and the integrator decides whether velocities
are known at whole or at half steps. Conditions and integrators read both from here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from gimpmd_gimp.grid import subcycling
from gimpmd_schemas.arrays import Bools, Floats

Integrator = Literal["usavg", "musl", "usl", "usf"]


class Clock:
    """Time steps and present times of all levels.

    Parameters
    ----------
    dt : float
        Time step of the finest level.
    top : int
        The finest level.
    integrator : Integrator

    Attributes
    ----------
    time : float
        Present time of the positions of the finest level.
    steps : int
        Steps of the finest level so far.
    velocity_time : ndarray, shape ``(top + 1,)``
        Time at which the velocities of each level are known.
    span : ndarray, shape ``(top + 1,)``
        Length of the last kick of each level.
    kicked : ndarray of bool, shape ``(top + 1,)``
        Levels whose kick of the present step is done.
    """

    def __init__(self, dt: float, top: int, integrator: Integrator) -> None:
        self.dt, self.top, self._integrator = dt, top, integrator
        self.time, self.steps = 0.0, 0
        self.velocity_time: Floats = np.zeros(top + 1)
        self.span: Floats = np.full(top + 1, dt)
        self.kicked: Bools = np.zeros(top + 1, dtype=np.bool_)

    @property
    def levels(self) -> range:
        """All levels."""
        return range(self.top + 1)

    def dt_of(self, level: int) -> float:
        """Time step of a level."""
        return self.dt * 2 ** (self.top - level)

    def at_whole_steps(self, level: int) -> bool:
        """Whether the velocities of a level are known at whole steps; if not, at half steps."""
        if self._integrator == "usavg":
            return level == self.top
        return self._integrator in ("usl", "usf")

    def moving_velocity_at(self, level: int) -> Literal["middle", "end", "both ends"]:
        """Where in a step the nodal velocities that move points are known.

        Points of the finest level move half a step with each of the velocities at both ends of
        the step under USAVG.
        """
        if not self.at_whole_steps(level):
            return "middle"
        return "both ends" if self._integrator == "usavg" else "end"

    def velocities_are_present(self) -> bool:
        """Whether no velocity has to be brought to the present time for exact energies."""
        return not self.steps or all(self.at_whole_steps(level) for level in self.levels)

    def coarsest(self) -> int:
        """The coarsest level that takes part in the next step."""
        return subcycling.coarsest(self.steps, self.top)

    def synchronous(self) -> bool:
        """Whether all levels have reached the present time."""
        return self.coarsest() == 0

    def next_span(self, level: int) -> float:
        """Length of the next kick of a level; the first one leads to the first half step."""
        half_first = self.steps == 0 and not self.at_whole_steps(level)
        return self.dt_of(level) * (0.5 if half_first else 1.0)

    def start_kick(self, levels: Sequence[int]) -> None:
        """Set the length of the kicks of some levels."""
        self.kicked[:] = False
        for level in levels:
            self.span[level] = self.next_span(level)

    def end_kick(self, levels: Sequence[int]) -> None:
        """Advance the times at which the velocities of some levels are known."""
        for level in levels:
            self.velocity_time[level] += self.span[level]
            self.kicked[level] = True

    def advance(self) -> None:
        """Advance the present time by one step of the finest level."""
        self.time += self.dt
        self.steps += 1

    def share_to_present(self) -> Floats:
        """Part of the last kick of each level that leads from its velocities to the present."""
        if not self.steps:
            return np.zeros(self.top + 1)
        return (self.time - self.velocity_time) / self.span

"""Nodes on a face of the domain whose velocity component is prescribed."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from functools import partial
from typing import ClassVar

import numpy as np

from gimpmd_gimp.boundary.condition import Condition, Kick
from gimpmd_gimp.grid.clock import Clock
from gimpmd_gimp.grid.nodes import Nodes
from gimpmd_gimp.points.body import Body
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.conditions import Face
from gimpmd_schemas.case.face_parts import FacePart, in_part
from gimpmd_schemas.grid.zones import Box


class Prescribed(Condition, ABC):
    """Base of the conditions that prescribe a velocity component on a face.

    Nodes of the basis on the face and beyond it take the prescribed value, level by level. The
    impulse that this needs counts as a load. A node beside a finer level also gets impulses in the
    steps of that level alone. It then keeps its velocity, whose change comes with its own level.

    Parameters
    ----------
    axis, side : int
        The face; side 0 is the lower one.
    component : int
        Axis of the component.
    value : callable
        The prescribed velocity or displacement over time.
    region : Box, optional
        The part of the face, see `FacePart.region`. None: all of the face.
    shape : callable, optional
        Function of position at rest, ``(n, d)`` to ``(n,)``, that multiplies the value. None: 1.
    """

    external: ClassVar[bool] = True
    reimposed: ClassVar[bool] = True

    def __init__(
        self,
        axis: int,
        side: int,
        component: int,
        value: Callable[[float], float],
        region: Box | None = None,
        shape: Callable[[Floats], Floats] | None = None,
    ) -> None:
        self._axis, self._side, self._component, self._value = axis, side, component, value
        self._region, self._shape = region, shape

    @abstractmethod
    def velocity(self, level: int, time: float) -> float:
        """Prescribed value of the nodal velocity of a level at a time."""

    def moving_velocity(self, level: int, time: float, kicked: bool) -> float:
        """Value of the nodal velocity that moves points during a step.

        Parameters
        ----------
        time : float
            Time at which the velocities of the level are known.
        kicked : bool
            Whether the kick of the present step is done.
        """
        return self.velocity(level, time)

    def attach(self, body: Body, nodes: Nodes, clock: Clock) -> None:
        """See ``Condition``."""
        super().attach(body, nodes, clock)
        mesh, self._nodes_of = body.mesh, dict[int, Ints]()
        self._scale = dict[int, Floats]()  # of the value at the nodes of a level
        within = in_part(self._region, mesh.positions())
        along = mesh.coords[:, self._axis]
        for level in clock.levels:
            last = mesh.hierarchy.count(level)[self._axis]
            beyond = along >= last if self._side else along <= 0
            found = np.flatnonzero(beyond & within & mesh.basis & (mesh.level == level))
            if found.size:
                self._nodes_of[level] = found
                x = mesh.positions()[found]
                self._scale[level] = np.ones(found.size) if self._shape is None else self._shape(x)
        # nodes of coarser levels that the steps of finer ones alone reach, by the coarsest of these
        self._beside = [
            [
                np.intersect1d(found, active.solved)
                for one, found in self._nodes_of.items()
                if one < level
            ]
            for level, active in enumerate(nodes.active)
        ]

    def constrain_change(self, kick: Kick) -> None:
        """See ``Condition``."""
        dV = self.nodes.dV
        for level, place in self._places():
            if level in kick.levels:
                time = self.clock.velocity_time[level]
                later = self.velocity(level, time + kick.span[level])
                change = self._scale[level] * (later - self.velocity(level, time))
                self._impose(place, change, dV)
        for beside in self._beside[kick.coarsest]:
            self._impose((beside, self._component), 0.0, dV)

    def constrain_velocity(self, V: Floats, coarsest: int, share: float) -> None:
        """See ``Condition``."""
        for level, place in self._places():
            time, kicked = self.clock.velocity_time[level], bool(self.clock.kicked[level])
            moving = share * self.moving_velocity(level, time, kicked)
            V[place] = self._scale[level] * moving

    def _impose(self, place: tuple[Ints, int], change: Floats | float, dV: Floats) -> None:
        """Give nodes a change of their velocity; the impulse that this needs is a load."""
        self.nodes.loads[place] += self.nodes.M[place[0]] * (change - dV[place])
        dV[place] = change

    def _places(self) -> Iterator[tuple[int, tuple[Ints, int]]]:
        """Every level with its nodes and the component, which together index nodal arrays."""
        for level, nodes in self._nodes_of.items():
            yield level, (nodes, self._component)


Driven = tuple[int, Callable[[float], float], Callable[[Floats], Floats] | None]
"""Component, value over time, and function of position that multiplies it."""


def driven(part: FacePart) -> Iterator[Driven]:
    """Components that a part of a face prescribes."""
    for axis, value in enumerate(part.components):
        if value is None:
            continue
        if isinstance(part.condition.value, tuple):
            yield axis, partial(_scaled, value, part.condition), None
        else:
            yield axis, part.condition.factor, partial(_component, part, axis)


def _scaled(value: float, face: Face, time: float) -> float:
    return value * face.factor(time)


def _component(part: FacePart, axis: int, x: Floats) -> Floats:
    return part.value(x)[:, axis]

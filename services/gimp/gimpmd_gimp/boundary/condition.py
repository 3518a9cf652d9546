"""What all conditions on the body share: when they may act in a step.

A step calls the hooks of its conditions in this order, each time for all conditions in the order
in which the solver holds them:

1. ``add_impulse``, once for every level that is kicked, when nodal sums are collected;
2. ``constrain_change``, when the change of the nodal velocity has been solved. After the
   dispersion correction the conditions with ``reimposed`` act once more;
3. ``constrain_motion``, where the integrator moves points with a velocity between two steps;
4. ``end_kick``, when the points have their new velocity and the nodes their new momentum;
5. ``constrain_velocity``, whenever a nodal velocity is computed from a momentum.

A new condition is a class with the hooks that it needs, in a module of its own. If a case file can
ask for it on a face, the module has a mapping ``FACE_CONDITIONS``, which says how it is made, and
``gimpmd_schemas.case.conditions`` has its name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from gimpmd_gimp.grid.clock import Clock
from gimpmd_gimp.grid.nodes import Nodes
from gimpmd_gimp.points.body import Body
from gimpmd_schemas.arrays import Bools, Floats
from gimpmd_schemas.case.face_parts import FacePart
from gimpmd_schemas.mechanics.units import Units


@dataclass(frozen=True)
class Kick:
    """A change of the velocities of some levels.

    Attributes
    ----------
    coarsest : int
        The coarsest level that steps: it selects the active set of the nodes.
    levels : sequence of int
        Levels whose forces act, the coarsest first.
    time : float
        Time at which loads are evaluated.
    span : ndarray, shape ``(top + 1,)``
        Length of the kick of each level.
    """

    coarsest: int
    levels: Sequence[int]
    time: float
    span: Floats


class Condition:
    """A condition on the body. All hooks do nothing unless a condition overrides them.

    Attributes
    ----------
    external : bool
        Whether the condition adds to ``nodes.loads``, whose work is the external work.
    viscous : bool
        Whether it adds to ``nodes.dashpot``.
    needs_velocity : bool
        Whether it reads the nodal velocity before the kick.
    reimposed : bool
        Whether ``constrain_change`` and ``constrain_velocity`` act again after the dispersion
        correction.
    dissipated : float
        Energy that the condition has turned into heat so far, on this rank.
    body, nodes, clock : Body, Nodes, Clock
        Of the solver, set by ``attach``.
    """

    external: ClassVar[bool] = False
    viscous: ClassVar[bool] = False
    needs_velocity: ClassVar[bool] = False
    reimposed: ClassVar[bool] = False

    dissipated: float = 0.0
    body: Body
    nodes: Nodes
    clock: Clock

    def attach(self, body: Body, nodes: Nodes, clock: Clock) -> None:
        """Become part of a solver; called once, before the first step.

        The solver works with a shallow copy of the condition, so that one condition can serve
        several solvers. Create here what the condition changes later.
        """
        self.body, self.nodes, self.clock = body, nodes, clock

    def regroup(self) -> None:
        """Find the points that are concerned; called whenever points have been sorted."""

    def add_impulse(self, kick: Kick, level: int) -> None:
        """Add the impulse on a level to ``nodes.loads``, ``nodes.impulse`` or ``nodes.dashpot``.

        The sums of this rank: parts on shared nodes are added up later.
        """

    def constrain_change(self, kick: Kick) -> None:
        """Correct ``nodes.dV``, the change of the nodal velocity, in place."""

    def constrain_motion(self) -> None:
        """Correct ``nodes.V`` where it is the velocity that moves points in this step."""

    def end_kick(self) -> None:
        """Accept the kick: ``nodes.P`` is the new momentum, ``nodes.V`` the velocity before."""

    def constrain_velocity(self, V: Floats, coarsest: int, share: float) -> None:
        """Correct a nodal velocity ``(size, d)``, in place.

        Parameters
        ----------
        coarsest : int
            The coarsest level that steps.
        share : float
            Prescribed components take this fraction of their value.
        """

    def leave_out(self, linked: Bools) -> None:
        """Clear the marks ``(size,)`` of nodes that the dispersion correction must not change."""

    def state(self) -> Mapping[str, Any]:
        """Arrays and numbers that a checkpoint must hold."""
        return {}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Return to a state that ``state`` described."""


ConditionMakers = Mapping[str, Callable[[FacePart, Units], list[Condition]]]
"""What makes the conditions of a part of a face (part, units), by ``condition`` of the case file.

A module of a condition that a case file can ask for has one with the name ``FACE_CONDITIONS``.
"""

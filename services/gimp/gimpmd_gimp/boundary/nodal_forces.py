"""Forces on nodes of the finest level that come from outside the continuum."""

from __future__ import annotations

from collections.abc import Callable

from gimpmd_gimp.boundary.condition import Condition, Kick
from gimpmd_schemas.arrays import Floats


class NodalForces(Condition):
    """Forces on nodes of the finest level, such as those of atoms that move with the grid.

    The code that gives the forces also counts their work.

    Parameters
    ----------
    add : callable
        ``add(span, J)`` adds the impulse over a span of time to nodal sums ``J``, shape
        ``(size, d)``. Ranks that share a node each add their part.
    """

    def __init__(self, add: Callable[[float, Floats], None]) -> None:
        self._add = add

    def add_impulse(self, kick: Kick, level: int) -> None:
        """See ``Condition``."""
        if level == self.clock.top:
            self._add(float(kick.span[level]), self.nodes.impulse)

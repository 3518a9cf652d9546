"""A force per mass on all points."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

from gimpmd_gimp.boundary.condition import Condition, Kick
from gimpmd_gimp.points.groups import OfLevel
from gimpmd_schemas.arrays import Floats


class BodyForce(Condition):
    """An acceleration of all points: ``f_i = sum_p S_ip m_p b_p``.

    Parameters
    ----------
    acceleration : callable
        ``b(X, t)``, shape ``(n, d)``, at reference positions ``(n, d)``.
    """

    external: ClassVar[bool] = True

    def __init__(self, acceleration: Callable[[Floats, float], Floats]) -> None:
        self._acceleration = acceleration

    def add_impulse(self, kick: Kick, level: int) -> None:
        """See ``Condition``."""
        b = kick.span[level] * self._acceleration(self.body.points.reference, kick.time)
        self.body.scatter(OfLevel(level), b, self.nodes.loads)

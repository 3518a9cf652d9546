"""Groups of material points that sweeps go over.

A group is a rule that selects points of a body. Groups are small values that compare equal when
the rules are equal, so a body can keep the sorted points of every group that is in use
(``Body.stripes``).

*Inner* points follow another code. They contribute to nodal sums of mass and momentum, but GIMP
neither deforms nor moves them. The *rim* is their last layer, where the points end inside the
body.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gimpmd_gimp.points.material_points import MaterialPoints
from gimpmd_schemas.arrays import Bools, Int32s


class Group(Protocol):
    """A rule that selects points."""

    def mask(self, points: MaterialPoints, summed: Int32s) -> Bools:
        """Which points belong to the group, shape ``(n,)``.

        Parameters
        ----------
        points : MaterialPoints
        summed : ndarray of int32, shape ``(n,)``
            Finest level in whose sub-steps each point contributes to nodal sums.
        """
        ...


@dataclass(frozen=True)
class All:
    """All points."""

    def mask(self, points: MaterialPoints, summed: Int32s) -> Bools:
        """See ``Group``."""
        return np.ones(points.count, dtype=np.bool_)


@dataclass(frozen=True)
class Flagged:
    """Points that carry a flag: one bit of ``MaterialPoints.flags``."""

    bit: int

    def mask(self, points: MaterialPoints, summed: Int32s) -> Bools:
        """See ``Group``."""
        return (points.flags & np.int32(self.bit)) != 0


ALL, INNER, RIM = All(), Flagged(1), Flagged(2)

FIRST_FREE_BIT = 4
"""The first flag that is not taken by ``INNER`` and ``RIM``."""


@dataclass(frozen=True)
class OfLevel:
    """Points of one level that GIMP deforms: inner points are left out."""

    level: int

    def mask(self, points: MaterialPoints, summed: Int32s) -> Bools:
        """See ``Group``."""
        return (points.level == self.level) & ~INNER.mask(points, summed)


@dataclass(frozen=True)
class MovedWith:
    """Points that move with the time step of one level: inner points are left out."""

    level: int

    def mask(self, points: MaterialPoints, summed: Int32s) -> Bools:
        """See ``Group``."""
        return (points.rate == self.level) & ~INNER.mask(points, summed)


@dataclass(frozen=True)
class MovedFrom:
    """Points that move with the time step of a level or of a finer one."""

    level: int

    def mask(self, points: MaterialPoints, summed: Int32s) -> Bools:
        """See ``Group``."""
        return points.rate >= self.level


@dataclass(frozen=True)
class Summed:
    """Points that contribute to nodal sums when a level is the coarsest that steps."""

    level: int

    def mask(self, points: MaterialPoints, summed: Int32s) -> Bools:
        """See ``Group``."""
        return summed >= self.level


@dataclass(frozen=True)
class OfLevels:
    """Points of the levels from ``first`` to ``last``, inner points included."""

    first: int
    last: int

    def mask(self, points: MaterialPoints, summed: Int32s) -> Bools:
        """See ``Group``."""
        return (points.level >= self.first) & (points.level <= self.last)


@dataclass(frozen=True)
class SummedBeside:
    """Points of ``Summed(level)`` that do not belong to the levels from ``first`` to ``last``."""

    level: int
    first: int
    last: int

    def mask(self, points: MaterialPoints, summed: Int32s) -> Bools:
        """See ``Group``."""
        return (summed >= self.level) & ~OfLevels(self.first, self.last).mask(points, summed)

"""Damping in regions: velocities decay, or are taken in part from the grid (PIC)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gimpmd_gimp.points.body import Body
from gimpmd_gimp.points.groups import Group
from gimpmd_gimp.points.material_points import MaterialPoints
from gimpmd_schemas.arrays import Bools, Floats, Ints


@dataclass(frozen=True)
class DampingRegion:
    """Where velocities decay, or are taken in part from the grid.

    Attributes
    ----------
    box : bounds of reference positions along each axis, or None for the whole body.
    rate : rate of decay (1 / time).
    flip : fraction of FLIP in the update of velocities; the rest is PIC.
    """

    box: tuple[tuple[float, float], ...] | None = None
    rate: float = 0.0
    flip: float = 1.0


class Damping:
    """Damping of a body; where regions overlap, the last one counts.

    Parameters
    ----------
    regions : sequence of DampingRegion
        At least one.
    counted : callable, optional
        Points at which positions ``(n, d)`` count in the energies; all points if left out.
    """

    def __init__(
        self, regions: Sequence[DampingRegion], counted: Callable[[Floats], Bools] | None = None
    ) -> None:
        self._regions, self._counted = tuple(regions), counted

    def regroup(self, points: MaterialPoints) -> None:
        """Find the rate of decay, the fraction of FLIP and the mass that counts of every point."""
        self._mass = points.mass
        if self._counted is not None:
            self._mass = np.where(self._counted(points.reference), points.mass, 0.0)
        self._rate, self._flip = np.zeros(points.count), np.ones(points.count)
        for region in self._regions:
            inside = np.ones(points.count, dtype=np.bool_)
            for axis, (low, high) in enumerate(region.box or ()):
                inside &= (points.reference[:, axis] >= low) & (points.reference[:, axis] <= high)
            self._rate[inside], self._flip[inside] = region.rate, region.flip

    def act(self, body: Body, group: Group, V: Floats, span: Floats) -> float:
        """Damp the velocities of a group over the last kick of each level.

        ``v_p <- exp(-rate span) (flip v_p + (1 - flip) sum_i S_ip V_i)``

        Parameters
        ----------
        V : ndarray, shape ``(size, d)``
            Nodal velocity after the kick.
        span : ndarray, shape ``(top + 1,)``
            Length of the kick of each level.

        Returns
        -------
        float
            Kinetic energy that this has taken from the points that count.
        """
        p, rows = body.points, body.stripes(group).order
        decay, grid = self._decay(p, rows, span), self._gathered(body, group, V)
        share, before = self._flip[rows, None], p.v[rows]
        after = decay * (share * before + (1.0 - share) * grid[rows])
        p.v[rows] = after
        return 0.5 * float(self._mass[rows] @ np.sum(before**2 - after**2, axis=1))

    def slow(self, body: Body, group: Group, V: Floats, span: Floats) -> None:
        """Take from the motion of a step what the decay at its end takes from its mean velocity.

        ``x_p += span / 2 (exp(-rate span) - 1) sum_i S_ip V_i``

        Parameters
        ----------
        V : ndarray, shape ``(size, d)``
            Nodal velocity after the kick, before the decay.
        span : ndarray, shape ``(top + 1,)``
            Length of the step of each level.
        """
        p, rows = body.points, body.stripes(group).order
        lost = self._decay(p, rows, span) - 1.0
        half = 0.5 * span[p.level[rows]][:, None]
        p.x[rows] += half * lost * self._gathered(body, group, V)[rows]

    def _decay(self, p: MaterialPoints, rows: Ints, span: Floats) -> Floats:
        """Factor ``(n, 1)`` of the velocities of some points."""
        return np.asarray(np.exp(-self._rate[rows] * span[p.level[rows]])[:, None])

    @staticmethod
    def _gathered(body: Body, group: Group, V: Floats) -> Floats:
        """Nodal velocity at the points of a group, shape ``(n, d)``; zero elsewhere."""
        grid = np.zeros_like(body.points.v)
        body.gather(group, V, 1.0, grid)
        return grid

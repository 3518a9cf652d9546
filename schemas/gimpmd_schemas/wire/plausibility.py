"""Monitors of the sums of one side: mass, speed and energy, whatever the case.

The energy balance of the whole body is small also for garbage: what one side does to the other is
work on both. These monitors ask what a solid body can do at all.
"""

from __future__ import annotations

import math

import numpy as np

from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.form import AT_PLANES
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.mechanics.units import UNITS
from gimpmd_schemas.wire.energies import Energies, from_array, to_array
from gimpmd_schemas.wire.findings import Finding, check

MASS = 1e-9
"""Largest relative change of the mass: far above round-off, far below one atom of any side."""

SPEED = 0.15
"""Largest speed (rms, about the mean velocity) over the speed of longitudinal waves, c.

Solids melt where ``k T`` is about 0.007 ``m c^2``: 0.005 for the plane Lennard-Jones crystal, 0.006
for tungsten, 0.007 for aluminium, 0.008 for iron and copper. (This is Lindemann's criterion, as
``m c^2`` measures the stiffness of bonds.) The speed of atoms is then 0.10 to 0.15 c. In a wave,
speed over c is the strain, and no crystal follows a strain of 0.15. In the sound runs behind
docs/monitors.md it was 0.09 at most.
"""

GAIN = 0.2
"""Largest energy without a source, over the energy that has one (`Plausibility`).

In the sound runs behind docs/monitors.md it was 0.04 at most. Losses are no findings: the velocity
schemes take out short waves, and viscous faces let waves out.
"""

LEAST_STRAIN = 1e-4
"""The energy of a side at this strain counts as explained, because shares of nothing mean nothing.
In the first steps of a run, work and energy belong to times up to half a step apart."""

INITIAL_STRAIN = 0.03
"""Strain whose energy is the largest that atoms may have at the start without a reason.

It is twice the energy of a dislocation in each thousand atoms. A potential that has become stronger
by 5 % in ``md.after`` changes the energy three times as much.
"""


class Plausibility:
    """What a side may do, from its first energies on.

    An energy has a source if it is there at the start, or is work of loads, fixes or the interface,
    or has been taken out on purpose (a random force may give it back). The velocity schemes have no
    such balance of one side: they exchange motion where the energies of the two sides overlap.

    Parameters
    ----------
    plan : Plan
    """

    def __init__(self, plan: Plan) -> None:
        self._square = plan.wave_speed("P") ** 2
        self._units = UNITS[plan.units]
        self._balanced = plan.coupling is None or plan.coupling.scheme in AT_PLANES
        self._start: Energies | None = None
        self._explained = 0.0

    def look(self, side: Energies) -> tuple[Finding, ...]:
        """Check the energies of a whole side at one step.

        Parameters
        ----------
        side : Energies
            Sums over the ranks of the side.
        """
        start = self._start = self._start or side
        if not start.mass > 0.0:  # a side may be empty
            return ()
        return (
            *check("mass", abs(side.mass / start.mass - 1.0), MASS),
            *check("speed", self._speed(side), SPEED),
            *(check("energy", self._gain(side, start), GAIN) if self._balanced else ()),
        )

    def state(self) -> Floats:
        """What a run that goes on needs, shape ``(8 + d,)``; empty before the first look."""
        if self._start is None:
            return np.empty(0)
        return np.array([self._explained, *to_array(self._start)])

    def restore(self, state: Floats) -> None:
        """Go on from a `state`."""
        if state.size:
            self._explained, self._start = float(state[0]), from_array(state[1:])

    def strain_energy(self, mass: float, strain: float) -> float:
        """Energy of a body at a uniaxial strain (energy units of the style)."""
        return self._units.energy_from_mechanical(0.5 * mass * self._square * strain**2)

    def _speed(self, side: Energies) -> float:
        """Root mean square of the velocity about its mean, over the speed of sound."""
        square = sum(p * p for p in side.momentum) / side.mass**2
        twice = 2.0 * self._units.energy_to_mechanical(side.kinetic) / side.mass
        return math.sqrt(max(0.0, twice - square) / self._square)

    def _gain(self, side: Energies, start: Energies) -> float:
        """Energy without a source over the largest energy with one so far."""
        done = [
            getattr(side, name) - getattr(start, name)
            for name in ("external_work", "fix_work", "interface_work", "dissipated")
        ]
        explained = start.kinetic + abs(start.potential) + sum(map(abs, done))
        explained += self.strain_energy(start.mass, LEAST_STRAIN)
        self._explained = max(self._explained, explained)
        external, fixes, interface, dissipated = done
        energy = side.kinetic + side.potential - start.kinetic - start.potential
        return (energy + dissipated - external - fixes - interface) / self._explained

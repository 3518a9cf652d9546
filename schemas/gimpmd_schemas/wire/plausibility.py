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
"""Largest energy without a source, over the energy that has one (`Gain`).

In the sound runs behind docs/monitors.md it was 0.04 at most for a side, and 0.1 at most for the
whole body in the velocity scheme. Losses are no findings: the velocity schemes take out short
waves, and viscous faces let waves out.
"""

LEAST_STRAIN = 1e-4
"""The energy of a side at this strain counts as explained, because shares of nothing mean nothing.
In the first steps of a run, work and energy belong to times up to half a step apart."""

INITIAL_STRAIN = 0.03
"""Strain whose energy is the largest that atoms may have at the start without a reason.

It is twice the energy of a dislocation in each thousand atoms. A potential that has become stronger
by 5 % in ``md.after`` changes the energy three times as much.
"""


def strain_energy(plan: Plan, mass: float, strain: float) -> float:
    """Energy of a body of the plan's material at a uniaxial strain (energy units of the style)."""
    energy = 0.5 * mass * plan.wave_speed("P") ** 2 * strain**2
    return UNITS[plan.units].energy_from_mechanical(energy)


class Gain:
    """Energy without a source of one side, or of the whole body, from its first energies on.

    An energy has a source if it is there at the start, or is work of loads, fixes or the interface,
    or has been taken out on purpose (a random force may give it back).

    Parameters
    ----------
    plan : Plan

    Attributes
    ----------
    start : Energies or None
        The first energies.
    explained : float
        Largest energy with a source so far.
    """

    def __init__(self, plan: Plan) -> None:
        self._least = strain_energy(plan, 1.0, LEAST_STRAIN)  # of a unit of mass
        self.start: Energies | None = None
        self.explained = 0.0

    def share(self, now: Energies) -> float:
        """Return the energy without a source over the largest energy with one so far."""
        start = self.start = self.start or now
        done = [
            getattr(now, name) - getattr(start, name)
            for name in ("external_work", "fix_work", "interface_work", "dissipated")
        ]
        explained = start.kinetic + abs(start.potential) + sum(map(abs, done))
        self.explained = max(self.explained, explained + start.mass * self._least)
        external, fixes, interface, dissipated = done
        energy = now.kinetic + now.potential - start.kinetic - start.potential
        return (energy + dissipated - external - fixes - interface) / self.explained


class Plausibility:
    """What a side may do, from its first energies on.

    The velocity schemes have no balance of the energy of one side: they exchange motion where the
    energies of the two sides overlap.

    Parameters
    ----------
    plan : Plan
    """

    def __init__(self, plan: Plan) -> None:
        self._square = plan.wave_speed("P") ** 2
        self._units, self._gain = UNITS[plan.units], Gain(plan)
        self._balanced = plan.coupling is None or plan.coupling.scheme in AT_PLANES

    def look(self, side: Energies) -> tuple[Finding, ...]:
        """Check the energies of a whole side at one step.

        Parameters
        ----------
        side : Energies
            Sums over the ranks of the side.
        """
        start = self._gain.start = self._gain.start or side
        if not start.mass > 0.0:  # a side may be empty
            return ()
        return (
            *check("mass", abs(side.mass / start.mass - 1.0), MASS),
            *check("speed", self._speed(side), SPEED),
            *(check("energy", self._gain.share(side), GAIN) if self._balanced else ()),
        )

    def state(self) -> Floats:
        """What a run that goes on needs, shape ``(8 + d,)``; empty before the first look."""
        if self._gain.start is None:
            return np.empty(0)
        return np.array([self._gain.explained, *to_array(self._gain.start)])

    def restore(self, state: Floats) -> None:
        """Go on from a `state`."""
        if state.size:
            self._gain.explained, self._gain.start = float(state[0]), from_array(state[1:])

    def _speed(self, side: Energies) -> float:
        """Root mean square of the velocity about its mean, over the speed of sound."""
        square = sum(p * p for p in side.momentum) / side.mass**2
        twice = 2.0 * self._units.energy_to_mechanical(side.kinetic) / side.mass
        return math.sqrt(max(0.0, twice - square) / self._square)

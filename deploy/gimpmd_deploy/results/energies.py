"""Mass, momentum and energies of a run over time, and how well its energy is balanced."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import h5py
import numpy as np

from gimpmd_deploy.results.frames import dataframe
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.wire.energies import SCALARS

ROLES: tuple[Role, ...] = ("md", "continuum")


@dataclass(frozen=True)
class SideEnergies:
    """Energies of one side at all ``k`` coupling steps (energy units of the case).

    Attributes
    ----------
    kinetic, potential : ndarray, shape ``(k,)``
        Potential energy is measured from the reference state.
    external_work, fix_work, interface_work, dissipated : ndarray, shape ``(k,)``
        Since the start: work of the loads on this side, work of the user's own fixes, work of the
        other side on this side, and energy that this side turned into heat on purpose.
    mass : ndarray, shape ``(k,)``
    momentum : ndarray, shape ``(k, d)``
    """

    kinetic: Floats
    potential: Floats
    external_work: Floats
    fix_work: Floats
    interface_work: Floats
    dissipated: Floats
    mass: Floats
    momentum: Floats

    @property
    def energy(self) -> Floats:
        """Kinetic and potential energy, shape ``(k,)``."""
        return self.kinetic + self.potential

    @classmethod
    def read(cls, group: h5py.Group, time: Floats) -> SideEnergies:
        """Read one side from ``series/<role>`` of ``run.h5``."""
        momentum = [group[f"momentum_{x}"][:] for x in "xyz" if f"momentum_{x}" in group]
        return cls(
            **{name: between(time, group[name][:]) for name in SCALARS},
            momentum=np.stack([between(time, values) for values in momentum], axis=1),
        )

    def columns(self) -> dict[str, Floats]:
        """Return all values by name, momentum by component."""
        momentum = {
            f"momentum_{x}": p for x, p in zip("xyz", np.transpose(self.momentum), strict=False)
        }
        return {name: getattr(self, name) for name in SCALARS} | momentum


class Scale(NamedTuple):
    """What an imbalance of energy is compared with: a value, and its name."""

    value: float
    name: str


@dataclass(frozen=True)
class RunEnergies:
    """Energies of a run at all ``k`` coupling steps (energy units of the case).

    A run records energies at some of its coupling steps; values between are interpolated.

    Attributes
    ----------
    time : ndarray, shape ``(k,)``
    sides : dict of SideEnergies by role, ``md`` and ``continuum``; only those that took part.
    energy, external_work, fix_work, dissipated : ndarray, shape ``(k,)``
        Sums over both sides: kinetic and potential energy, and since the start work of the loads,
        work of the user's own fixes, and energy turned into heat on purpose.
    """

    time: Floats
    sides: Mapping[Role, SideEnergies]
    energy: Floats
    external_work: Floats
    fix_work: Floats
    dissipated: Floats

    @classmethod
    def read(cls, series: h5py.Group) -> RunEnergies:
        """Read ``series`` of ``run.h5``."""
        time, total = series["time"][:], series["total"]
        return cls(
            time=time,
            sides={role: SideEnergies.read(series[role], time) for role in ROLES if role in series},
            energy=between(time, total["energy"][:]),
            external_work=between(time, total["external_work"][:]),
            fix_work=between(time, total["fix_work"][:]),
            dissipated=between(time, total["dissipated"][:]),
        )

    @property
    def md(self) -> SideEnergies:
        """Energies of the atoms; KeyError in a run of the continuum only."""
        return self.sides["md"]

    @property
    def continuum(self) -> SideEnergies:
        """Energies of the continuum; KeyError in a run of MD only."""
        return self.sides["continuum"]

    def total(self, name: str) -> Floats:
        """Return a quantity of `SideEnergies` summed over the sides, for example ``mass``."""
        return np.asarray(np.sum([getattr(side, name) for side in self.sides.values()], axis=0))

    @property
    def kinetic(self) -> Floats:
        """Kinetic energy of both sides, shape ``(k,)``."""
        return self.total("kinetic")

    @property
    def potential(self) -> Floats:
        """Potential energy of both sides, shape ``(k,)``."""
        return self.total("potential")

    @property
    def work(self) -> Floats:
        """Work of the loads and of the user's own fixes since the start, shape ``(k,)``."""
        return self.external_work + self.fix_work

    def imbalance(self) -> Floats:
        """Return the energy missing since the start, ``W - D - (E - E0)``, shape ``(k,)``.

        W is the work of loads and fixes, D the dissipated energy, E the energy and E0 its first
        value.
        """
        work, energy = self.work, self.energy
        return work - work[:1] - self.dissipated - (energy - energy[:1])

    def interface_loss(self) -> Floats:
        """Return the energy that the interface has removed from both sides, shape ``(k,)``.

        It is minus the sum of the interface work of both sides. In the velocity schemes it is the
        energy of waves and heat that the grid cannot carry. In the force scheme it is zero, as the
        two sides do opposite work on each other.
        """
        work = self.total("interface_work")
        return np.asarray(work[:1] - work)

    def scale(self) -> Scale:
        """Return the largest work or the energy at the start, whichever is larger."""
        work = float(np.abs(self.work).max(initial=0.0))
        start = float(np.abs(self.energy[:1]).max(initial=0.0))
        name = "work of loads and fixes" if self.fix_work.any() else "external work"
        return Scale(work, name) if work >= start else Scale(start, "initial energy")

    def largest_imbalance(self) -> float:
        """Return the largest absolute imbalance over the scale."""
        scale = self.scale().value
        return float(np.abs(self.imbalance()).max()) / scale if scale > 0.0 else 0.0

    def remaining_imbalance(self) -> float:
        """Return the imbalance at the end that the interface loss does not explain, over the scale.

        It is not exactly zero in the velocity schemes: forces at the ends of a time window
        represent those between, which is off by a few per cent of the heat.
        """
        scale = self.scale().value
        rest = self.imbalance() - self.interface_loss()
        return float(rest[-1]) / scale if scale > 0.0 else 0.0

    def to_dataframe(self) -> Any:
        """Return a pandas DataFrame with a row for each step.

        Columns of a side begin with its role, for example ``md_kinetic``.

        Raises
        ------
        BackendError
            pandas is not installed.
        """
        columns = {name: getattr(self, name) for name in ("time", "energy", "external_work")}
        columns |= {"fix_work": self.fix_work, "dissipated": self.dissipated}
        for role, side in self.sides.items():
            columns |= {f"{role}_{name}": values for name, values in side.columns().items()}
        return dataframe(columns)


def between(time: Floats, values: Floats) -> Floats:
    """Replace gaps (NaN) by linear interpolation in time."""
    known = np.isfinite(values)
    return np.interp(time, time[known], values[known]) if known.any() else values

"""Energy release rate of a growing crack from the energies of a run, and its resistance.

Let W be the work of the loads, D the energy dissipated on purpose, U the potential energy of both
sides, K their kinetic energy, a the area of the crack. The potential energy of the atoms contains
the energy of the new surfaces, ``2 gamma`` per area: the resistance R of the crack. So the elastic
energy is ``U - R (a - a0)``. Two rates per advance follow:

- *static*: ``d(W - D - U) / da + R``, what the loads and the elastic energy give. Part of it
  becomes kinetic energy. The crack arrests where it falls below R.
- *dynamic*: the static rate less what becomes elastic waves, that is what flows into the tip:
  the resistance, and the heat of the atoms. This is the rate that a J-integral measures.

A run that conserves energy has ``W - D - U - K = const``. So the dynamic rate is known only as well
as waves and heat are told apart: heat is the motion of atoms that differs from the linear motion of
their surroundings. Its kinetic energy is measured, and its potential energy is taken to be equal.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gimpmd_deploy.analysis.crack import Crack, CrackGrowth, crack_of
from gimpmd_deploy.analysis.plane import Plane
from gimpmd_deploy.results.frames import dataframe
from gimpmd_deploy.results.particles import Particles
from gimpmd_deploy.results.run import Run
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.mechanics.units import UNITS

LEAST_ADVANCE = 3.0
"""Advance of the crack in a window, in atom spacings, below which no rate is given."""

SURROUNDINGS = 6.0
"""Edge of the cells in which motion is called linear, in atom spacings."""


@dataclass(frozen=True)
class EnergyReleaseRate:
    """Energy release rate at ``k`` outputs (pressure times length; NaN where the crack rests).

    Attributes
    ----------
    time, length : ndarray, shape ``(k,)``
    static : ndarray, shape ``(k,)``
        From work and elastic energy, including what becomes kinetic energy.
    dynamic : ndarray, shape ``(k,)``
        Without the kinetic and elastic energy of waves.
    resistance : float
        Energy of the new surfaces per advance.
    """

    time: Floats
    length: Floats
    static: Floats
    dynamic: Floats
    resistance: float

    def to_dataframe(self) -> Any:
        """Return a pandas DataFrame with a row for each output."""
        return dataframe(vars(self))


def energy_release_rate(
    run: Run,
    growth: CrackGrowth,
    resistance: float,
    window: float,
    *,
    crack: Crack | None = None,
    front: float = 1.0,
) -> EnergyReleaseRate:
    """Energy release rate of a growing crack from the energies of a run.

    Parameters
    ----------
    run : Run
        A run with atoms, around which the crack grows.
    growth : CrackGrowth
        From `crack_growth`. Its outputs should be so close that the tip passes some atoms between
        two of them.
    resistance : float
        Energy ``2 gamma`` of both surfaces (pressure times length), see `crack_resistance`.
    window : float
        Rates are slopes of straight lines over the outputs in a time window of this width.
    crack : Crack, optional
        The crack of ``growth``; default is the first of the case.
    front : float
        Length of the crack front in three dimensions.

    Returns
    -------
    EnergyReleaseRate
    """
    plane = (crack or crack_of(run)).plane
    energies, units = run.energies, UNITS[run.plan.units]
    per_advance = units.nktv2p / front

    def at(values: Floats) -> Floats:
        return per_advance * np.interp(growth.time, energies.time, values)

    given = at(energies.external_work - energies.dissipated - energies.potential)
    mass = run.plan.continuum.material.density * _volume(run)
    to_energy = units.energy_from_mechanical(mass)
    heat = np.array(
        [2.0 * to_energy * thermal_motion(run.atoms(time), plane) for time in growth.time]
    )
    lost = given - at(energies.kinetic) + per_advance * heat
    slopes = [rate_per_advance(growth, energy, window) for energy in (given, lost)]
    return EnergyReleaseRate(
        time=growth.time,
        length=growth.length,
        static=slopes[0] + resistance,
        dynamic=slopes[1] + resistance,
        resistance=resistance,
    )


def _volume(run: Run) -> float:
    """Volume (in two dimensions area) of an atom."""
    return 0.0 if run.atoms_file is None else run.atoms_file.lattice[1]


def rate_per_advance(growth: CrackGrowth, energy: Floats, window: float) -> Floats:
    """Slope of an energy over the crack length, shape ``(k,)``.

    A straight line is fitted to the outputs in a time window around each output. NaN where the
    crack advances by less than three atom spacings in the window.

    Parameters
    ----------
    energy : ndarray, shape ``(k,)``
        At the outputs of ``growth``.
    window : float
        Width of the window.
    """
    rates = np.full(growth.time.size, np.nan)
    for k, time in enumerate(growth.time):
        near = np.abs(growth.time - time) <= 0.5 * window * (1.0 + 1e-9)
        length = growth.length[near]
        if np.ptp(length) >= LEAST_ADVANCE * growth.spacing:
            rates[k] = np.polyfit(length - length.mean(), energy[near], 1)[0]
    return rates


def thermal_motion(atoms: Particles, plane: Plane) -> float:
    """Half the sum of the squared velocities with which atoms leave the motion of their region.

    The regions are cells of six atom spacings on either side of a plane, across which the velocity
    may jump. The motion of a region is a linear function of the position, fitted to its atoms.

    Returns
    -------
    float
        ``sum |v - fit|^2 / 2``, with the number of atoms of each cell reduced by the number of
        parameters of the fit.
    """
    x, v, d = atoms.position, atoms.velocity, atoms.dim
    cells = np.floor(x / (SURROUNDINGS * float(atoms.size[0, 0]))).astype(np.int64)
    above = plane.height(atoms.reference) >= 0.0
    cell = np.unique(np.column_stack([cells, above]), axis=0, return_inverse=True)[1].ravel()
    count = np.bincount(cell)
    n = count.size

    def mean(field: Floats) -> Floats:
        return (
            np.stack([np.bincount(cell, column, n) for column in field.T], axis=1) / count[:, None]
        )

    x = x - mean(x)[cell]
    v = v - mean(v)[cell]
    spread = mean((x[:, :, None] * x[:, None, :]).reshape(-1, d * d)).reshape(n, d, d)
    mixed = mean((v[:, :, None] * x[:, None, :]).reshape(-1, d * d)).reshape(n, d, d)
    fitted = count > 2 * (d + 1)
    spread[~fitted], mixed[~fitted] = np.eye(d), 0.0
    rest = v - np.einsum("nij,nj->ni", (mixed @ np.linalg.inv(spread))[cell], x)
    squares = np.bincount(cell, (rest**2).sum(axis=1), n)
    free = np.where(fitted, count / np.maximum(count - d - 1.0, 1.0), 0.0)
    return 0.5 * float(squares @ free)

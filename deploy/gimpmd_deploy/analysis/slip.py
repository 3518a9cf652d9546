"""Slip along a plane between two plates: history, events, speed of slip pulses, self-healing.

The slip of an atom above the plane is its displacement along the plane, relative to the mean of its
nearest neighbours below the plane in the reference state. In steps of the lattice period, an atom
falls from one valley of the potential of the other row into the next. So it has slipped n times
when its slip has passed ``n - 1/2`` periods.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from gimpmd_deploy.analysis.plane import Plane, bonds_across
from gimpmd_deploy.results.frames import dataframe
from gimpmd_deploy.results.particles import Particles
from gimpmd_deploy.results.run import Run
from gimpmd_schemas.arrays import Floats

SLIDING = 0.25
"""Share of the largest slip rate above which an atom counts as sliding."""


@dataclass(frozen=True)
class SlipHistory:
    """Slip at ``m`` atoms above a plane and ``k`` outputs: a space-time map.

    Attributes
    ----------
    time : ndarray, shape ``(k,)``
    position : ndarray, shape ``(m,)``
        Of the atoms along the plane in the reference state, increasing.
    slip, rate : ndarray, shape ``(k, m)``
        Displacement and velocity along the plane, relative to the atoms below.
    opening : ndarray, shape ``(k, m)``
        Displacement along the normal, relative to the atoms below.
    period : float
        Distance of two atoms in the row.
    """

    time: Floats
    position: Floats
    slip: Floats
    rate: Floats
    opening: Floats
    period: float

    def between(self, low: float, high: float) -> SlipHistory:
        """Return the history of the atoms in a part of the plane."""
        part = (self.position >= low) & (self.position <= high)
        return replace(
            self,
            position=self.position[part],
            slip=self.slip[:, part],
            rate=self.rate[:, part],
            opening=self.opening[:, part],
        )


def slip_history(
    run: Run, plane: Plane, times: Sequence[float] | None = None, period: float | None = None
) -> SlipHistory:
    """Follow the slip along a plane through the outputs of a run.

    Parameters
    ----------
    run : Run
        A run with atoms.
    plane : Plane
        Between two rows of atoms, along the direction of slip.
    times : sequence of float, optional
        Some of the outputs; default is all of them.
    period : float, optional
        Lattice period along the plane; by default the distance of the atoms in the row above.

    Raises
    ------
    InputError
        The run has no atoms.
    ValueError
        There are no atoms on both sides of the plane.
    """
    chosen = list(run.times if times is None else times)
    rows = [_relative_motion(run.atoms(time), plane) for time in chosen]
    position = rows[0].position
    if period is None:
        steps = np.diff(position)
        period = float(np.median(steps[steps > 0.1 * steps.max(initial=0.0)]))
    return SlipHistory(
        time=np.array(chosen),
        position=position,
        slip=np.stack([row.slip for row in rows]),
        rate=np.stack([row.rate for row in rows]),
        opening=np.stack([row.opening for row in rows]),
        period=period,
    )


class _Row(NamedTuple):
    position: Floats
    slip: Floats
    rate: Floats
    opening: Floats


def _relative_motion(atoms: Particles, plane: Plane) -> _Row:
    """Motion of the atoms above the plane relative to their neighbours below, by position."""
    above, below = bonds_across(plane, atoms.reference, float(atoms.size[0, 0]))
    if above.size == 0:
        raise ValueError("the atoms do not lie on both sides of the plane")
    sites, which, counts = np.unique(above, return_inverse=True, return_counts=True)

    def relative(field: Floats, direction: Floats) -> Floats:
        values = field @ direction
        return np.asarray(values[sites] - np.bincount(which, values[below]) / counts)

    position = plane.position(atoms.reference[sites])
    order = np.argsort(position, kind="stable")
    return _Row(
        position[order],
        relative(atoms.displacement, plane.along)[order],
        relative(atoms.velocity, plane.along)[order],
        relative(atoms.displacement, plane.normal)[order],
    )


@dataclass(frozen=True)
class SlipEvents:
    """Times at which atoms slipped.

    Attributes
    ----------
    position : ndarray, shape ``(m,)``
        Of the atoms along the plane.
    time : ndarray, shape ``(n, m)``
        Row ``i`` holds the time at which each atom slipped for the ``i + 1``-th time; NaN where it
        did not.
    """

    position: Floats
    time: Floats

    @property
    def first(self) -> Floats:
        """Time at which each slip began, the earliest of all atoms, shape ``(n,)``."""
        return np.asarray(np.nanmin(self.time, axis=1))

    @property
    def origin(self) -> Floats:
        """Position at which each slip began, shape ``(n,)``."""
        return np.asarray(self.position[np.nanargmin(self.time, axis=1)])

    def between(self, low: float, high: float) -> SlipEvents:
        """Return the events of the atoms in a part of the plane."""
        chosen = (self.position >= low) & (self.position <= high)
        time = self.time[:, chosen]
        return SlipEvents(self.position[chosen], time[np.isfinite(time).any(axis=1)])

    def to_dataframe(self) -> Any:
        """Return a pandas DataFrame with a row for each event: number, position and time."""
        number, atom = np.nonzero(np.isfinite(self.time))
        columns = {
            "number": number + 1,
            "position": self.position[atom],
            "time": self.time[number, atom],
        }
        return dataframe(columns)


def slip_events(history: SlipHistory) -> SlipEvents:
    """Find when each atom slipped by one lattice period, and by further ones.

    Slip in either direction counts. An atom has slipped n times when its slip passes
    ``n - 1/2`` periods for the first time. Times between outputs are interpolated.
    """
    periods = np.abs(history.slip) / history.period
    count = int(np.floor(periods.max(initial=0.0) + 0.5))
    time = [_passing(history.time, periods, n + 0.5) for n in range(count)]
    return SlipEvents(history.position, np.array(time).reshape(count, history.position.size))


def _passing(time: Floats, values: Floats, level: float) -> Floats:
    """First time at which each column of ``values (k, m)`` reaches a level; NaN if it does not."""
    over = values >= level
    after, columns = np.argmax(over, axis=0), np.arange(values.shape[1])
    before = np.maximum(after - 1, 0)
    low, high = values[before, columns], values[after, columns]
    share = np.where(after > before, (level - low) / np.where(high > low, high - low, 1.0), 0.0)
    found = time[before] + share * (time[after] - time[before])
    return np.asarray(np.where(over.any(axis=0), found, np.nan))


@dataclass(frozen=True)
class PulseSpeed:
    """Speed of a slip pulse: slope of a line through its events.

    Attributes
    ----------
    speed : float
        Positive if the pulse runs along the direction of the plane.
    error : float
        Standard error of the speed.
    start : float
        Time at which the fitted line passes the origin of the plane.
    atoms : int
        Number of events.
    """

    speed: float
    error: float
    start: float
    atoms: int


def pulse_speed(events: SlipEvents, number: int = 1) -> PulseSpeed:
    """Fit the speed of a slip pulse.

    Parameters
    ----------
    events : SlipEvents
        ``events.between(low, high)`` leaves out the place where the pulse begins.
    number : int
        1 for the first pulse, with which atoms slip for the first time.

    Raises
    ------
    ValueError
        Fewer than three atoms have slipped so often, or all at the same time.
    """
    from scipy.stats import linregress

    time = events.time[number - 1] if 1 <= number <= len(events.time) else np.empty(0)
    known = np.isfinite(time)
    if known.sum() < 3:
        raise ValueError(f"pulse {number} has passed {known.sum()} atoms; its speed needs three")
    fit = linregress(events.position[known], time[known])
    if fit.slope == 0.0:
        raise ValueError(f"all atoms slip at the same time in pulse {number}")
    return PulseSpeed(
        speed=float(1.0 / fit.slope),
        error=float(fit.stderr / fit.slope**2),
        start=float(fit.intercept),
        atoms=int(known.sum()),
    )


class Patch(NamedTuple):
    """Neighbouring atoms that slide at one time: positions of the first and last, largest rate."""

    start: float
    end: float
    rate: float


def sliding_patches(
    history: SlipHistory, index: int, threshold: float | None = None
) -> list[Patch]:
    """Find the patches of the plane that slide at an output; between them the plates stick.

    Parameters
    ----------
    index : int
        Number of the output in ``history.time``.
    threshold : float, optional
        Slip rate above which an atom slides; by default a quarter of the largest in the history.
    """
    rate, x = np.abs(history.rate[index]), history.position
    sliding = rate > _threshold(history, threshold)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], sliding.astype(np.int8), [0]])))
    return [
        Patch(float(x[low]), float(x[high - 1]), float(rate[low:high].max()))
        for low, high in edges.reshape(-1, 2)
    ]


def _threshold(history: SlipHistory, threshold: float | None) -> float:
    return SLIDING * float(np.abs(history.rate).max()) if threshold is None else threshold


@dataclass(frozen=True)
class StickSlip:
    """How much of a plane slides at ``k`` outputs.

    A crack-like rupture slides everywhere behind its front: its longest patch grows with the
    slipped length. A self-healing pulse slides near its front only, and sticks behind it: its
    longest patch keeps its length, and the rate behind is close to zero.

    Attributes
    ----------
    time : ndarray, shape ``(k,)``
    patches : ndarray of int, shape ``(k,)``
        Number of patches that slide.
    longest : ndarray, shape ``(k,)``
        Length of the longest of them.
    slipped : ndarray, shape ``(k,)``
        Length of the plane that has slipped by at least one period.
    sliding : ndarray, shape ``(k,)``
        Share of that length which slides.
    behind : ndarray, shape ``(k,)``
        Root mean square of the rate of atoms that have slipped and do not slide, over the largest
        rate in the history; NaN where there are none.
    """

    time: Floats
    patches: Floats
    longest: Floats
    slipped: Floats
    sliding: Floats
    behind: Floats

    def to_dataframe(self) -> Any:
        """Return a pandas DataFrame with a row for each output."""
        return dataframe(vars(self))


def stick_slip(history: SlipHistory, threshold: float | None = None) -> StickSlip:
    """Measure how much of the plane slides over time, and whether slip heals behind its front.

    Parameters
    ----------
    threshold : float, optional
        See `sliding_patches`.
    """
    least, a = _threshold(history, threshold), history.period
    rate, peak = np.abs(history.rate), float(np.abs(history.rate).max())
    slipped = np.abs(history.slip) >= 0.5 * a
    sliding = rate > least
    healed = slipped & ~sliding
    squares = np.where(healed, rate**2, 0.0).sum(axis=1)
    rms = np.sqrt(squares / np.where(healed.any(axis=1), healed.sum(axis=1), np.nan))
    patches = [sliding_patches(history, k, least) for k in range(history.time.size)]
    return StickSlip(
        time=history.time,
        patches=np.array([len(found) for found in patches]),
        longest=np.array(
            [max((p.end - p.start + a for p in found), default=0.0) for found in patches]
        ),
        slipped=a * slipped.sum(axis=1),
        sliding=(slipped & sliding).sum(axis=1) / np.maximum(slipped.sum(axis=1), 1),
        behind=rms / peak if peak > 0.0 else rms,
    )


@dataclass(frozen=True)
class RowProfile:
    """The row of atoms above a plane at one time, as in figure 19 of the paper.

    Attributes
    ----------
    position : ndarray, shape ``(m,)``
        Along the plane in the reference state, increasing.
    velocity : ndarray, shape ``(m,)``
        Component along the plane.
    relative_velocity : ndarray, shape ``(m,)``
        The same, relative to the atoms below the plane.
    potential_energy : ndarray, shape ``(m,)``, or None
        None if the run wrote no potential energies of atoms.
    """

    position: Floats
    velocity: Floats
    relative_velocity: Floats
    potential_energy: Floats | None


def row_profile(atoms: Particles, plane: Plane) -> RowProfile:
    """Velocity and potential energy of the atoms along a slip plane (paper figure 19).

    Parameters
    ----------
    atoms : Particles
        Of one output, ``run.atoms(time)``.
    plane : Plane
        Its normal points to the row that is taken.

    Raises
    ------
    ValueError
        There are no atoms on both sides of the plane.
    """
    row = _relative_motion(atoms, plane)
    above = np.unique(bonds_across(plane, atoms.reference, float(atoms.size[0, 0])).above)
    above = above[np.argsort(plane.position(atoms.reference[above]), kind="stable")]
    energy = atoms.fields.get("potential_energy")
    return RowProfile(
        position=row.position,
        velocity=atoms.velocity[above] @ plane.along,
        relative_velocity=row.rate,
        potential_energy=None if energy is None else np.asarray(energy, dtype=float)[above],
    )

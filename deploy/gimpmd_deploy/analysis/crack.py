"""Crack tip from the atoms, and the growth of a crack over time.

An atom is *exposed* if it has lost at least a fifth of its neighbours: atoms that were nearer than
1.3 distances of neighbours in the reference state are counted there and now. A free surface exposes
its atoms; a dislocation does not, since its atoms lose one neighbour in six or find new ones; nor
do surfaces that were there from the start. Exposed atoms belong to the crack if a chain of exposed
atoms with steps of a few spacings leads to the initial crack. The tip is the foremost of them in
the direction of growth. So voids ahead of the tip are not part of the crack, a few atoms that
bridge it do not end it, and a crack that leaves its plane or branches is followed.

The rule counts distances only, so a rotation of the body changes nothing. The faces of the initial
crack count as open even where they touch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from gimpmd_deploy.analysis.plane import Plane
from gimpmd_deploy.results.frames import dataframe
from gimpmd_deploy.results.particles import Particles
from gimpmd_deploy.results.run import Run
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.errors import InputError, Problem

STRETCH = 1.3
"""Range within which neighbours are counted, in distances of nearest neighbours.

It lies between the first and the second shell of the close-packed lattices. A pair bond of
Lennard-Jones pulls hardest at 1.11.
"""

LOST = 0.2
"""Share of its neighbours that an exposed atom has lost.

A face of close-packed rows or planes takes a third (hexagonal) or a quarter (fcc) of them.
"""

BRIDGE = 4.0
"""Longest step between exposed atoms of one crack, in distances of neighbours."""

RESTED = 3.0
"""Number of atoms that a crack would have passed in the time for which it must rest."""


@dataclass(frozen=True)
class Crack:
    """A straight crack in the reference state, before it grows.

    Attributes
    ----------
    plane : Plane
        Through the mouth (or the rear end) of the crack, along the direction of growth.
    length : float
        Distance of the initial tip from the mouth.
    """

    plane: Plane
    length: float

    @classmethod
    def between(cls, mouth: ArrayLike, tip: ArrayLike, normal: ArrayLike | None = None) -> Crack:
        """Make the crack from its mouth to its initial tip; see `Plane.through` for the normal."""
        start, end = np.asarray(mouth, dtype=float), np.asarray(tip, dtype=float)
        return cls(Plane.through(start, end - start, normal), float(np.linalg.norm(end - start)))


def crack_of(run: Run, number: int = 0) -> Crack:
    """Return a crack that the case of a run names in ``continuum.cracks``.

    Raises
    ------
    InputError
        The case names no crack of this number.
    """
    cracks = run.plan.continuum.cracks
    if number >= len(cracks):
        hint = "name the crack in the case, or make one with Crack.between(mouth, tip)"
        problem = Problem("continuum.cracks", None, f"has no crack of number {number}", hint)
        raise InputError(str(run.folder), [problem])
    crack = cracks[number]
    normal = None
    if crack.along is not None:
        normal = np.cross(crack.along, np.subtract(crack.end, crack.start))
    return Crack.between(crack.start, crack.end, normal)


@dataclass(frozen=True)
class CrackTip:
    """A crack tip at one time.

    Attributes
    ----------
    time : float
    length : float
        Distance of the tip from the mouth in the direction of growth, in the reference state.
    reference, position : ndarray, shape ``(d,)``
        The atom at the tip, in the reference state and now. As long as the crack has not grown,
        the atom nearest to the initial tip.
    """

    time: float
    length: float
    reference: Floats
    position: Floats


def crack_tip(
    atoms: Particles, crack: Crack, *, stretch: float = STRETCH, bridge: float = BRIDGE
) -> CrackTip:
    """Find the tip of a crack from the atoms.

    Parameters
    ----------
    atoms : Particles
        Of one output, ``run.atoms(time)``, in two or three dimensions.
    crack : Crack
        The crack before it grows; ``crack_of(run)`` is that of the case.
    stretch : float
        Range within which neighbours are counted, in distances of nearest neighbours.
    bridge : float
        Longest step between exposed atoms of one crack, in distances of nearest neighbours.

    Returns
    -------
    CrackTip
        The initial tip as long as no exposed atom is ahead of it. In three dimensions it is the
        foremost point of the front.
    """
    plane, spacing = crack.plane, float(atoms.size[0, 0])
    bare = exposed(atoms, stretch)
    sites = atoms.reference[bare]
    own = np.flatnonzero(_connected(sites, _distance(sites, crack), bridge * spacing))
    ahead = plane.position(sites[own])
    if own.size and ahead.max() > crack.length:
        tip = bare[own[np.argmax(ahead)]]
        length = float(ahead.max())
    else:
        start = plane.origin + crack.length * plane.along
        tip = int(np.argmin(((atoms.reference - start) ** 2).sum(axis=1)))
        length = crack.length
    return CrackTip(atoms.time, length, atoms.reference[tip], atoms.position[tip])


def exposed(atoms: Particles, stretch: float = STRETCH) -> Ints:
    """Find the atoms that have lost at least a fifth of their neighbours; returns their indices."""
    reach = stretch * float(atoms.size[0, 0])
    before, now = (
        cKDTree(x).query_ball_point(x, reach, return_length=True) - 1
        for x in (atoms.reference, atoms.position)
    )
    return np.flatnonzero(now <= (1.0 - LOST) * before)


def _distance(sites: Floats, crack: Crack) -> Floats:
    """Distance of positions ``(n, d)`` from the initial crack, in the plane of growth."""
    s, height = crack.plane.position(sites), crack.plane.height(sites)
    return np.asarray(np.hypot(s - np.clip(s, 0.0, crack.length), height))


def _connected(sites: Floats, distance: Floats, step: float) -> Bools:
    """Whether chains with steps up to ``step`` lead from the sites to the initial crack."""
    pairs = cKDTree(sites).query_pairs(step, output_type="ndarray")
    n = len(sites)
    links = coo_array((np.ones(len(pairs)), pairs.T), shape=(n, n))
    label = connected_components(links, directed=False)[1]
    return np.isin(label, np.unique(label[distance <= step]))


@dataclass(frozen=True)
class CrackGrowth:
    """A crack at ``k`` outputs of a run.

    Attributes
    ----------
    time, length : ndarray, shape ``(k,)``
        Length from the mouth to the tip in the reference state.
    position : ndarray, shape ``(k, d)``
        Where the tip is.
    spacing : float
        Distance of neighbouring atoms; the tip is known to about half of it.
    """

    time: Floats
    length: Floats
    position: Floats
    spacing: float

    @property
    def start(self) -> float | None:
        """Time at which growth starts: the last output before the tip has left its place.

        The tip has left its place when it is more than one atom spacing ahead of its first place,
        on its way to its farthest one. None if it has not.
        """
        still = np.flatnonzero(self.length <= self.length[0] + self.spacing)
        before = still[still < self.length.argmax()]
        grown = self.length.max() > self.length[0] + self.spacing
        return float(self.time[before[-1]]) if grown else None

    @property
    def arrest(self) -> float | None:
        """Time at which growth ends: the first output at which the tip is at its farthest place.

        That is, within one atom spacing. A crack whose faces close again later has a tip that goes
        back from there. None if the crack has not grown, or if it has rested, or gone back, for
        less time than it took on average to pass three atoms.
        """
        if self.start is None:
            return None
        farthest = self.length.max()
        end = float(self.time[np.flatnonzero(self.length >= farthest - self.spacing)[0]])
        speed = (farthest - self.length[0]) / (end - self.start)
        rested = float(self.time[-1]) - end
        return end if rested >= RESTED * self.spacing / speed else None

    def speed(self, window: float) -> Floats:
        """Speed of the tip, shape ``(k,)``: slope of a line through the outputs of a time window.

        Parameters
        ----------
        window : float
            Width of the window around each output, at least two output intervals.
        """
        return np.array([_slope(self.time, self.length, t, window) for t in self.time])

    def to_dataframe(self) -> Any:
        """Return a pandas DataFrame with a row for each output."""
        place = {f"position_{x}": p for x, p in zip("xyz", self.position.T, strict=False)}
        return dataframe({"time": self.time, "length": self.length, **place})


def _slope(time: Floats, values: Floats, at: float, window: float) -> float:
    chosen = np.abs(time - at) <= 0.5 * window * (1.0 + 1e-9)
    t = time[chosen]
    return float(np.polyfit(t - at, values[chosen], 1)[0]) if t.size > 1 else np.nan


def crack_growth(
    run: Run,
    crack: Crack | None = None,
    times: Sequence[float] | None = None,
    *,
    stretch: float = STRETCH,
    bridge: float = BRIDGE,
) -> CrackGrowth:
    """Follow the tip of a crack through the outputs of a run.

    Parameters
    ----------
    run : Run
        A run with atoms.
    crack : Crack, optional
        The crack before it grows; default is the first one of the case.
    times : sequence of float, optional
        Some of the outputs; default is all of them.
    stretch, bridge : float
        See `crack_tip`.

    Raises
    ------
    InputError
        The run has no atoms, or its case names no crack.
    """
    chosen = crack_of(run) if crack is None else crack
    tips, spacing = [], 0.0
    for time in run.times if times is None else times:
        atoms = run.atoms(time)
        spacing = float(atoms.size[0, 0])
        tips.append(crack_tip(atoms, chosen, stretch=stretch, bridge=bridge))
    return CrackGrowth(
        time=np.array([tip.time for tip in tips]),
        length=np.array([tip.length for tip in tips]),
        position=np.array([tip.position for tip in tips]),
        spacing=spacing,
    )

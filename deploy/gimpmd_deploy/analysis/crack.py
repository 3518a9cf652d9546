"""Crack tip from the atoms, and the growth of a crack over time.

An atom beside the crack plane is *separated* if no atom of the other side is nearer than a stretch
times the distance of neighbours. Only atoms with a neighbour on the other side in the reference
state count. The tip is the foremost separated atom, on the way from the initial tip along the
plane; the way ends at a part of the plane that is closed over several lattice spacings. So voids
far ahead are not part of the crack, and a few atoms that bridge it do not end it.

The rule asks for distances only, so neither rotation of the body nor slip along the plane looks
like a crack. Below the initial tip, the faces count as open even where they touch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from gimpmd_deploy.analysis.plane import Plane, bonds_across
from gimpmd_deploy.results.frames import dataframe
from gimpmd_deploy.results.particles import Particles
from gimpmd_deploy.results.run import Run
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.errors import InputError, Problem

STRETCH = 1.3
"""Distance of separated atoms, in distances of nearest neighbours.

A pair bond of Lennard-Jones pulls hardest at 1.11. In hexagonal rows that slide over each other
atoms stay within 1.1 of an atom of the other row.
"""

BRIDGE = 4.0
"""Longest closed part of the plane that belongs to the crack, in distances of neighbours."""

LAYERS = 4.0
"""Atoms within so many distances of neighbours from the plane may face it after slip."""


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
        Distance of the tip from the mouth along the plane, in the reference state.
    reference : ndarray, shape ``(d,)``
        The tip on the plane in the reference state.
    position : ndarray, shape ``(d,)``
        Where the tip is now: midway between the nearest atoms on both sides of the plane.
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
        Atoms are separated if they are farther apart than this many distances of neighbours.
    bridge : float
        Longest closed part of the plane that belongs to the crack, in distances of neighbours.

    Returns
    -------
    CrackTip
        The initial tip as long as no atom ahead of it is separated. In three dimensions it is the
        foremost point of the front.

    Raises
    ------
    ValueError
        There are no atoms on both sides of the plane.
    """
    plane, spacing = crack.plane, float(atoms.size[0, 0])
    height = plane.height(atoms.reference)
    near = np.flatnonzero(np.abs(height) < LAYERS * spacing)
    sites, height, now = atoms.reference[near], height[near], atoms.position[near]
    above, below = bonds_across(plane, sites, spacing)
    if above.size == 0:
        raise ValueError("the atoms do not lie on both sides of the crack plane")
    sides = (np.unique(above), height < 0.0), (np.unique(below), height >= 0.0)
    separated = [
        side[cKDTree(now[others]).query(now[side])[0] > stretch * spacing] for side, others in sides
    ]
    ahead = np.sort(plane.position(sites[np.concatenate(separated)]))
    length = _reach(crack.length, ahead, bridge * spacing)
    reference = plane.origin + length * plane.along
    beside = [_nearest(sites, side, reference) for side, _ in sides]
    return CrackTip(atoms.time, length, reference, now[beside].mean(axis=0))


def _reach(start: float, ahead: Floats, bridge: float) -> float:
    """Last of the sorted positions that can be reached from ``start`` by steps up to ``bridge``."""
    way = np.concatenate([[start], ahead[ahead > start]])
    gaps = np.flatnonzero(np.diff(way) > bridge)
    return float(way[gaps[0]] if gaps.size else way[-1])


def _nearest(sites: Floats, chosen: Ints, place: Floats) -> int:
    return int(chosen[np.argmin(((sites[chosen] - place) ** 2).sum(axis=1))])


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

        The tip has left its place when it is more than one atom spacing ahead of its first place
        for good. None if it has not.
        """
        still = np.flatnonzero(self.length <= self.length[0] + self.spacing)
        return None if still[-1] == self.time.size - 1 else float(self.time[still[-1]])

    @property
    def arrest(self) -> float | None:
        """Time at which growth ends: the first output at which the tip is at its last place.

        That is, within one atom spacing, then and at all later outputs. None if the crack has not
        grown, or still grows between the last two outputs.
        """
        if self.start is None:
            return None
        moving = np.flatnonzero(np.abs(self.length - self.length[-1]) > self.spacing)
        first = int(moving[-1]) + 1
        return None if first == self.time.size - 1 else float(self.time[first])

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

"""Whether a pair potential jumps at its cutoff.

A potential that is cut off at a distance where it is not zero changes the energy by its value there
with every bond that comes into or leaves its range, without any work. Forces are not affected.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimpmd_md.engines.lammps.library import Engine

_ROWS = 400
_INNER = 0.3
"""Distances from this fraction of the cutoff on are looked at."""

_OUTER = 0.4
"""Depths are looked for from this fraction of the cutoff on, away from the repulsive core."""

_NARROWINGS = 2
"""Each one locates the cutoff `_ROWS` times more precisely. Two find it to about 1e-8 of itself,
over which no smooth potential changes noticeably."""

NOTICEABLE = 1e-5
"""Smallest jump that is worth a word, over the depth of the potential."""


@dataclass(frozen=True)
class Jump:
    """The jump of a pair potential at its cutoff.

    Attributes
    ----------
    types : tuple of int
        Types of the two atoms.
    distance : float
        Where the potential ends (length).
    energy : float
        Its value there (energy units).
    depth : float
        Depth of its minimum, positive; if it is nowhere negative, its largest value in the outer
        part of its range.
    """

    types: tuple[int, int]
    distance: float
    energy: float
    depth: float


def largest_jump(engine: Engine, cutoff: float) -> Jump | None:
    """Largest noticeable jump among all pairs of types; collective.

    None if there is none, or if the potential depends on more than distance and types.

    Parameters
    ----------
    engine : Engine
        After the script of the atoms.
    cutoff : float
        Longest range of the potential.
    """
    if not engine.is_of_distance():
        return None
    types = range(1, int(engine.lammps.extract_global("ntypes")) + 1)
    found = [_jump(engine, one, other, cutoff) for one in types for other in types[one - 1 :]]
    large = [jump for jump in found if abs(jump.energy) > NOTICEABLE * jump.depth]
    return max(large, key=lambda jump: abs(jump.energy), default=None)


def _jump(engine: Engine, one: int, other: int, cutoff: float) -> Jump:
    """The last value of the potential that is not zero."""
    low, high = _INNER * cutoff, (1.0 + 1.0 / _ROWS) * cutoff
    table = engine.pair_table(one, other, low, high, _ROWS)
    outer = table[table[:, 0] > _OUTER * cutoff, 1]
    depth = float(-outer.min(initial=0.0)) or float(outer.max(initial=0.0))
    for _ in range(_NARROWINGS):
        acting = np.flatnonzero(table[:, 1])
        if acting.size in (0, len(table)):
            break
        low, high = table[acting[-1], 0], table[acting[-1] + 1, 0]
        table = engine.pair_table(one, other, low, high, _ROWS)
    acting = np.flatnonzero(table[:, 1])
    if not acting.size:
        return Jump((one, other), cutoff, 0.0, 1.0)
    distance, energy, _ = table[acting[-1]]
    return Jump((one, other), float(distance), float(energy), depth)


def sentence(jump: Jump, script: str, unit: str) -> str:
    """What the user should know about a jump."""
    return (
        f"the pair potential of types {jump.types[0]} and {jump.types[1]} is {jump.energy:.3g} "
        f"{unit} at its cutoff of {jump.distance:.6g}; each bond that crosses the cutoff changes "
        "the energy by that value without work, which the energy balance shows; write "
        f"pair_modify shift yes into {script} (forces stay the same)"
    )

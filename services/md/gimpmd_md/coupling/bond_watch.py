"""Watch of the bonds near the planes: whether a defect has reached the interface.

Beyond the planes the continuum is a perfect crystal. It cannot take over a dislocation, a crack or
a vacancy, so no defect may come near them. Every defect that moves there breaks bonds: a pair of
nearest neighbours is further apart than a crystal can stretch it.

Two atoms are *nearest neighbours* if at rest they are closer than ``NEIGHBOURS`` times the least
distance of any two watched atoms. Their bond is *broken* if it is longer than ``BROKEN`` times its
length at rest. Two atoms *overlap* if they have come closer to each other than their distance at
rest over ``BROKEN``, whether they are nearest neighbours or have one atom in between (``SHELLS``):
slip brings atoms together that were two rows apart, and so does a crack that closes at another
place. All of this holds for hexagonal, face-centred and body-centred cubic crystals:

- Slip by a lattice vector, or by a partial dislocation of an fcc crystal, leaves some nearest
  neighbours at 1.41 (fcc, stacking fault), 1.63 (bcc) or 1.73 (hexagonal) times their distance, and
  brings as many pairs from there to the distance of nearest neighbours.
- Elastic strain stays below: the force of a Lennard-Jones bond is largest at a stretch of 1.11.
- Thermal motion stays below: by Lindemann's criterion an atom moves by about a tenth of the
  spacing (rms) at the melting temperature. At a tenth of that temperature the length of a bond
  then changes by about 3 % (rms), and 25 % are eight standard deviations.
- A rotation of the crystal does not change the lengths of bonds.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from gimpmd_md.engines.atoms import Atoms
from gimpmd_md.roles import WATCHED
from gimpmd_md.sums import periods
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.compiled import njit
from gimpmd_schemas.grid.planes import deepest
from gimpmd_schemas.wire.findings import Finding, Kind, check

DEPTH = 2.0
"""Depth below the planes, in cutoffs, to which bonds are watched.

This is the depth to which the force scheme requires a perfect crystal at the start. It must be more
than one cutoff: ghosts do not slip, so they hold a dislocation back about one cutoff below the
planes."""

NEIGHBOURS = 1.2
"""Largest distance of nearest neighbours at rest, over the least distance of any two atoms."""

BROKEN = 1.25
"""Stretch at which a bond counts as broken; at its inverse, a pair of atoms overlaps."""

SHELLS = 2.1
"""Largest distance of the pairs that are watched for overlaps, over the least distance at rest."""


class BondWatch:
    """The bonds near the planes, or near the outer zone, of one patch.

    Parameters
    ----------
    plan : Plan
        Of a coupled run.
    atoms : Atoms
    """

    def __init__(self, plan: Plan, atoms: Atoms) -> None:
        self._plan, self._atoms = plan, atoms
        self._bonds = NeighbourBonds(atoms.comm, periods(plan.background_grid()))

    def near(self, margin: float = 0.0) -> Bools:
        """Which atoms, by lattice position, are outside the planes or close to them inside.

        Parameters
        ----------
        margin : float
            How much deeper than ``DEPTH`` cutoffs (length).
        """
        near: Bools = _depth(self._plan, self._atoms.site) < DEPTH * self._atoms.cutoff + margin
        return near

    def roles(self) -> Ints:
        """Role bits by lattice position, shape ``(n,)``: `WATCHED` near the planes."""
        return np.where(self.near(), WATCHED, 0)

    def look(self) -> tuple[Finding, ...]:
        """Look at the bonds of this rank; collective."""
        atoms = self._atoms
        rows = np.flatnonzero(atoms.role & np.int32(WATCHED))
        return self._bonds.look(atoms.rest[rows], atoms.x[rows])


def _depth(plan: Plan, x: Floats) -> Floats:
    """Depth of lattice positions below the planes, or below the outer zone; negative outside."""
    coupling = plan.coupled
    if coupling.interfaces:
        return deepest(coupling.interfaces, x)
    return coupling.zones.depth(x) - coupling.zones.outer


class NeighbourBonds:
    """Bonds between nearest neighbours, some of which join atoms of two ranks.

    The bonds follow from the positions at rest. They are found again only when the atoms of a rank
    have changed, or their order.

    Parameters
    ----------
    comm : mpi4py communicator
    period : ndarray, shape ``(d,)``
        Length of the domain along each axis, 0 where it is not periodic.
    """

    def __init__(self, comm: Any, period: Floats) -> None:
        self._comm, self._period = comm, period
        self._rest: Floats | None = None
        self._shared = np.empty(0, dtype=np.int64)
        self._reach = 0.0

    def look(self, rest: Floats, x: Floats) -> tuple[Finding, ...]:
        """Find broken bonds and overlaps of which the first atom is on this rank; collective.

        Parameters
        ----------
        rest, x : ndarray, shape ``(n, d)``
            Positions at rest and now, of this rank's atoms; either may be wrapped at periodic
            faces.

        Returns
        -------
        tuple of Finding
            The longest bond if it is broken, and the pair that has come closest if it overlaps.
        """
        known = self._rest is not None and np.array_equal(rest, self._rest)
        # one exchange as long as no rank has other atoms than before
        others = self._comm.allgather(x[self._shared] if known else None)
        if any(part is None for part in others):
            self._connect(rest.copy())
            others = self._comm.allgather(x[self._shared])
        x = np.concatenate([x, *others])
        longest, shortest = extremes(x, self._pairs, self._squared, self._bonded, self._period)
        return (
            *self._finding("broken bond", x, longest, 1.0),
            *self._finding("overlap", x, shortest, -1.0),
        )

    def _finding(self, kind: Kind, x: Floats, pair: int, power: float) -> tuple[Finding, ...]:
        """The finding about a pair, if there is one; the value is a power of its stretch."""
        if pair < 0:
            return ()
        i, j = self._pairs[pair]
        away = _shortest(x[j] - x[i], self._period)
        stretch = float((away @ away / self._squared[pair]) ** 0.5)
        return check(kind, stretch**power, BROKEN, x[i] + 0.5 * away)

    def _connect(self, rest: Floats) -> None:
        """Find the bonds, and the atoms of which other ranks must know the position."""
        comm, self._rest = self._comm, rest
        if not self._reach:
            self._least = float(min(comm.allgather(self._least_distance(rest))))
            self._reach = SHELLS * self._least
        self._shared = self._near_others(rest)
        others = comm.allgather(rest[self._shared])
        places = np.concatenate([rest, *others])
        owners = np.repeat([comm.rank, *range(comm.size)], [len(rest), *map(len, others)])
        pairs = self._tree(places).query_pairs(self._reach, output_type="ndarray")
        first, second = pairs.T  # first < second
        # a bond between two ranks belongs to the lower one; each rank sees its own atoms twice
        kept = (first < len(rest)) & ((second < len(rest)) | (owners[second] > comm.rank))
        self._pairs = pairs[kept]
        away = _shortest(places[second[kept]] - places[first[kept]], self._period)
        self._squared = (away**2).sum(axis=1)
        self._bonded = self._squared < (NEIGHBOURS * self._least) ** 2

    def _least_distance(self, rest: Floats) -> float:
        if len(rest) < 2:
            return np.inf
        return float(self._tree(rest).query(self._wrapped(rest), k=2)[0][:, 1].min())

    def _near_others(self, rest: Floats) -> Ints:
        """Rows of the atoms within reach of the box around the atoms of another rank."""
        empty = np.full((2, rest.shape[1]), np.nan)
        box = np.array([rest.min(axis=0), rest.max(axis=0)]) if len(rest) else empty
        near: Bools = np.zeros(len(rest), dtype=np.bool_)
        for rank, (low, high) in enumerate(self._comm.allgather(box)):
            if rank != self._comm.rank:
                away = np.abs(_shortest(rest - 0.5 * (low + high), self._period))
                near |= (away <= 0.5 * (high - low) + self._reach).all(axis=1)
        return np.flatnonzero(near)

    def _tree(self, x: Floats) -> cKDTree:
        return cKDTree(self._wrapped(x), boxsize=self._period)

    def _wrapped(self, x: Floats) -> Floats:
        """Positions with periodic coordinates from 0 to the period, as `cKDTree` wants them."""
        x = x.copy()
        for axis in np.flatnonzero(self._period):
            x[:, axis] %= self._period[axis]
            x[x[:, axis] >= self._period[axis], axis] = 0.0  # round-off
        return x


def _shortest(away: Floats, period: Floats) -> Floats:
    """Differences ``(..., d)`` between the closest periodic images."""
    safe = np.where(period > 0.0, period, np.inf)
    return away - np.where(period > 0.0, period * np.round(away / safe), 0.0)


@njit(cache=True)
def extremes(
    x: Floats, pairs: Ints, squared: Floats, bonded: Bools, period: Floats
) -> tuple[int, int]:
    """Find the bond with the largest stretch, and the pair of atoms with the least.

    Parameters
    ----------
    x : ndarray, shape ``(n, d)``
        Present positions.
    pairs : ndarray of int, shape ``(m, 2)``
        Rows of the two atoms of each pair.
    squared : ndarray, shape ``(m,)``
        Squared length at rest.
    bonded : ndarray of bool, shape ``(m,)``
        Which pairs are nearest neighbours.
    period : ndarray, shape ``(d,)``
        Length of the domain along each axis, 0 where it is not periodic.

    Returns
    -------
    longest, shortest : int
        Rows of the two pairs, -1 if there is none.
    """
    longest, shortest, most, least = -1, -1, 0.0, np.inf
    for pair in range(pairs.shape[0]):
        length = 0.0
        for axis in range(x.shape[1]):
            away = x[pairs[pair, 1], axis] - x[pairs[pair, 0], axis]
            if period[axis] > 0.0:
                away -= period[axis] * np.round(away / period[axis])
            length += away * away
        ratio = length / squared[pair]
        if bonded[pair] and ratio > most:
            longest, most = pair, ratio
        if ratio < least:
            shortest, least = pair, ratio
    return longest, shortest

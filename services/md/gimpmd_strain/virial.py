"""Virial strain: left Cauchy-Green tensor from the nearest neighbours (paper Eqs. 3 and 4)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.spatial import cKDTree

from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.compiled import njit
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_strain.box import Configuration

CUTOFF = 1.2
"""Default range of neighbours, in distances of nearest neighbours.

It lies between the first and the second shell of the hexagonal, fcc, hcp, diamond and simple cubic
lattices. In bcc it includes the second shell (1.155); these 14 neighbours are as isotropic as the
nearest 8.
"""

MAX_ANISOTROPY = 0.1
"""Largest accepted value of ``|sum dX dX / R^2 / lambda - 1|``.

Thermal motion stays below it. A missing neighbour of the hexagonal lattice gives 1/3 or more.
"""


@dataclass(frozen=True)
class Neighbours:
    """Neighbours of some atoms in the undeformed state.

    Attributes
    ----------
    start : ndarray of int64, shape ``(n + 1,)``
        The neighbours of atom a are ``index[start[a]:start[a + 1]]``.
    index : ndarray of int64, shape ``(p,)``
        Indices among all atoms.
    image : ndarray, shape ``(p, d)``
        Periodic image of that atom, in whole box edges.
    R2 : ndarray, shape ``(p,)``
        Squared undeformed distance.
    factor : ndarray, shape ``(n,)``
        Lattice factor lambda: the number of neighbours divided by d, since
        ``sum dX_i dX_j / R^2 = lambda delta_ij``. NaN where the neighbourhood is not isotropic.
    """

    start: Ints
    index: Ints
    image: Floats
    R2: Floats
    factor: Floats

    def counts(self) -> Ints:
        """Number of neighbours of each atom."""
        return np.diff(self.start)


def find_neighbours(own: Floats, all_: Configuration, cutoff: float) -> Neighbours:
    """Find the neighbours of atoms at ``own``, shape ``(n, d)``, in a configuration.

    ``own`` must be positions of atoms of the configuration. An atom is not its own neighbour, but
    its periodic images may be.
    """
    d = own.shape[1]
    box = all_.box
    x, atom, image = _with_images(all_, cutoff)
    home = np.where(box.periodic, np.floor(box.fractions(own)), 0.0)
    inside = own - home @ box.edges.T
    tree = cKDTree(x)
    found = tree.query_ball_point(inside, cutoff, return_sorted=True)
    counts = np.fromiter((len(near) for near in found), np.int64, len(own))
    flat = np.concatenate([np.empty(0, np.int64), *(np.asarray(n, np.int64) for n in found)])
    a = np.repeat(np.arange(len(own)), counts)
    R2 = ((inside[a] - x[flat]) ** 2).sum(axis=1)
    other = R2 > 0.0
    a, flat, R2 = a[other], flat[other], R2[other]
    start = np.concatenate([[0], np.cumsum(np.bincount(a, minlength=len(own)))])

    factor = np.diff(start) / d
    image = image[flat] + home[a]
    tensor = np.zeros((len(own), d, d))
    _sum_pairs(start, atom[flat], image @ box.edges.T, R2, own, all_.x, tensor)
    with np.errstate(invalid="ignore", divide="ignore"):
        uneven = np.abs(tensor / factor[:, None, None] - np.eye(d)).max(axis=(1, 2), initial=0.0)
    factor = np.where(uneven < MAX_ANISOTROPY, factor, np.nan)  # no neighbours: NaN < x is False
    return Neighbours(start, atom[flat], image, R2, factor)


def virial_strain(neighbours: Neighbours, own: Floats, now: Configuration) -> Floats:
    """Eulerian strain ``(1 - B^-1) / 2`` with ``B = sum dx dx / R^2 / lambda`` (Eqs. 3 and 4).

    Parameters
    ----------
    neighbours : Neighbours
        Neighbours of some atoms.
    own : ndarray, shape ``(n, d)``
        Present unwrapped positions of these atoms.
    now : Configuration
        All atoms, in the same order as when the neighbours were found.

    Returns
    -------
    ndarray, shape ``(n, d, d)``
        NaN where the undeformed neighbourhood is not isotropic; the formula is not valid there.
    """
    d = own.shape[1]
    B = np.zeros((len(own), d, d))
    _sum_pairs(
        neighbours.start,
        neighbours.index,
        neighbours.image @ now.box.edges.T,
        neighbours.R2,
        own,
        now.x,
        B,
    )
    valid = np.isfinite(neighbours.factor)
    factor = np.where(valid, neighbours.factor, 1.0)[:, None, None]
    B = np.where(valid[:, None, None], B / factor, np.eye(d))
    valid &= np.abs(np.linalg.det(B)) > np.finfo(float).eps  # all neighbours on one line
    B[~valid] = np.eye(d)
    strain = 0.5 * (np.eye(d) - np.linalg.inv(B))
    strain[~valid] = np.nan
    return strain


def nearest_distance(all_: Configuration) -> float:
    """Median distance of an atom's nearest neighbour (length units).

    Raises
    ------
    InputError
        There are fewer than two atoms, or atoms are at the same place.
    """
    if len(all_.x) < 2:
        hint = "give a configuration of a whole body"
        raise InputError("atomic strain", [Problem("atoms", len(all_.x), "too few atoms", hint)])
    box = all_.box
    volume = abs(float(np.linalg.det(box.edges))) / len(all_.x)
    x, _, _ = _with_images(all_, 2.0 * volume ** (1.0 / len(box.origin)))
    home = np.where(box.periodic, np.floor(box.fractions(all_.x)), 0.0)
    distance = float(np.median(cKDTree(x).query(all_.x - home @ box.edges.T, k=2)[0][:, 1]))
    if not 0.0 < distance < np.inf:
        hint = "look for overlapping atoms"
        raise InputError("atomic strain", [Problem("spacing", distance, "is not a distance", hint)])
    return distance


def _with_images(all_: Configuration, reach: float) -> tuple[Floats, Ints, Floats]:
    """Wrap atoms into the box, and add their periodic images within ``reach`` of it.

    Returns
    -------
    x : ndarray, shape ``(m, d)``
    atom : ndarray of int64, shape ``(m,)``
    image : ndarray, shape ``(m, d)``
        ``x = x_atom + edges @ image``.
    """
    box, d = all_.box, all_.x.shape[1]
    fractions = box.fractions(all_.x)
    home = np.where(box.periodic, np.floor(fractions), 0.0)
    fractions = fractions - home
    margin = np.where(box.periodic, reach / box.heights(), np.inf)
    shells = np.where(box.periodic, np.ceil(margin), 0.0).astype(int)
    places, images = [], []
    for shift in product(*(range(-s, s + 1) for s in shells)):
        moved = fractions + shift
        near = ((moved >= -margin) & (moved <= 1.0 + margin)).all(axis=1)
        places.append(np.flatnonzero(near))
        images.append(np.array(shift, float) - home[near])
    atom, image = np.concatenate(places), np.concatenate(images).reshape(-1, d)
    return all_.x[atom] + image @ box.edges.T, atom, image


@njit(cache=True)
def _sum_pairs(
    start: Ints, index: Ints, shift: Floats, R2: Floats, own: Floats, x: Floats, B: Floats
) -> None:
    d = own.shape[1]
    for a in range(own.shape[0]):
        for p in range(start[a], start[a + 1]):
            b = index[p]
            for i in range(d):
                for j in range(d):
                    B[a, i, j] += (
                        (own[a, i] - x[b, i] - shift[p, i])
                        * (own[a, j] - x[b, j] - shift[p, j])
                        / R2[p]
                    )

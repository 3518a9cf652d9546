"""The crystal that atoms form, in two or three dimensions: translations, basis and layers.

Any crystal in any orientation is recognised, with any number of atoms in its primitive cell: fcc,
bcc, hcp, diamond, ordered alloys. A translation of the crystal takes an atom to one of the same
type whose neighbours are at the same places.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.zones import Box

SAME = 1e-4
"""Distance, over that of nearest neighbours, up to which atoms are at the same place."""

SURROUNDINGS = 2.2
"""Range of the neighbours that are compared, in distances of nearest neighbours."""

MULTIPLES = 6
"""Largest multiple of a primitive vector in a period along an axis."""


@dataclass(frozen=True)
class Layers:
    """Layers of atoms normal to an axis.

    Attributes
    ----------
    period : float
        Distance after which they repeat (length).
    places : ndarray, shape ``(n,)``
        Coordinates of the layers of one period, ascending.
    """

    period: float
    places: Floats

    def spacing(self) -> float | None:
        """Distance of the layers; None if they are unevenly spaced."""
        gaps = self._gaps()
        return float(gaps.mean()) if np.ptp(gaps) < SAME * gaps.mean() else None

    def midway(self) -> Floats:
        """Coordinates midway between neighbouring layers, for one period."""
        return np.asarray(self.places + 0.5 * self._gaps())

    def _gaps(self) -> Floats:
        return np.diff(np.append(self.places, self.places[0] + self.period))


class CrystalSites(NamedTuple):
    """Sites of a crystal: positions ``(n, d)``, and which atom of the basis each holds."""

    x: Floats
    member: Ints

    def take(self, chosen: Bools) -> CrystalSites:
        """Some of them."""
        return CrystalSites(self.x[chosen], self.member[chosen])


@dataclass(frozen=True)
class Crystal:
    """Atoms at ``origin + basis + n @ vectors``, for all integers n (length).

    Attributes
    ----------
    vectors : ndarray, shape ``(d, d)``
        Primitive vectors as rows, the shortest ones, right-handed.
    origin : ndarray, shape ``(d,)``
    basis : ndarray, shape ``(b, d)``
        Places of the atoms of a primitive cell relative to the origin; the first is 0.
    kinds : ndarray of int, shape ``(b,)``
        Their types.
    """

    vectors: Floats
    origin: Floats
    basis: Floats
    kinds: Ints

    @property
    def volume(self) -> float:
        """Area or volume of the primitive cell."""
        return float(abs(np.linalg.det(self.vectors)))

    def misfit(self, x: Floats) -> Floats:
        """Distances of positions ``(n, d)`` from the closest sites (length)."""
        return distances(self.vectors, self.origin, self.basis, x).min(axis=0)

    def sites(self, box: Box) -> CrystalSites:
        """All sites in a half-open box."""
        corners = np.array(list(product(*box))) - self.origin
        ends = corners @ np.linalg.inv(self.vectors)
        axes = [
            np.arange(start - 1, end + 1)
            for start, end in zip(
                np.floor(ends.min(axis=0)).astype(int),
                np.ceil(ends.max(axis=0)).astype(int),
                strict=True,
            )
        ]
        n = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(box))
        x = (self.origin + n @ self.vectors + self.basis[:, None]).reshape(-1, len(box))
        low, high = np.array(box).T
        inside = ((x >= low) & (x < high)).all(axis=1)
        return CrystalSites(x, np.repeat(np.arange(len(self.basis)), len(n))).take(inside)

    def period(self, axis: int) -> float | None:
        """Shortest translation along an axis; None if there is none."""
        dim = len(self.vectors)
        n = np.array(list(product(range(-MULTIPLES, MULTIPLES + 1), repeat=dim)))
        t = n @ self.vectors
        size = np.abs(self.vectors).max()
        across = np.delete(t, axis, axis=1)
        along = t[(np.abs(across) < SAME * size).all(axis=1) & (t[:, axis] > SAME * size), axis]
        return float(along.min()) if along.size else None

    def layers(self, axis: int) -> Layers | None:
        """Layers normal to an axis; None if the atoms form none, in a crystal that is turned."""
        heights, size = self.vectors[:, axis], np.abs(self.vectors).max()
        tolerance = SAME * size
        period = reduce(lambda a, b: _divisor(a, b, tolerance), np.abs(heights).tolist())
        if period < 0.02 * size:
            return None
        places = (self.origin[axis] + self.basis[:, axis]) % period
        places = np.sort(np.where(places > period - tolerance, places - period, places))
        return Layers(period, places[np.append(True, np.diff(places) > tolerance)])


def distances(vectors: Floats, origin: Floats, basis: Floats, x: Floats) -> Floats:
    """Distances of positions ``(n, d)`` from the closest sites of each atom of the basis.

    The first three arguments are those of `Crystal`.

    Returns
    -------
    ndarray, shape ``(b, n)``
    """
    found = np.empty((len(basis), len(x)))
    for place, away in zip(basis, found, strict=True):
        n = (x - origin - place) @ np.linalg.inv(vectors)
        away[:] = np.linalg.norm((n - np.rint(n)) @ vectors, axis=1)
    return found


def recognise(x: Floats, kinds: Ints) -> Crystal:
    """Find the crystal of atoms around the middle of a body.

    Parameters
    ----------
    x : ndarray, shape ``(n, d)``
        Positions of atoms that are a perfect crystal around the middle of the body, up to at least
        five distances of neighbours from it.
    kinds : ndarray of int, shape ``(n,)``
        Types of the atoms.

    Raises
    ------
    BackendError
        The atoms around the middle form no crystal.
    """
    dim, tree = x.shape[1], cKDTree(x)
    seed = int(np.argmin(np.linalg.norm(x - 0.5 * (x.min(axis=0) + x.max(axis=0)), axis=1)))
    spacing = float(tree.query(x[seed], k=2)[0][1])
    around = [k for k in tree.query_ball_point(x[seed], SURROUNDINGS * spacing) if k != seed]
    environment, types = x[around] - x[seed], kinds[around]
    translations = (
        x[k] - x[seed]
        for k in np.argsort(np.linalg.norm(x - x[seed], axis=1), kind="stable")[1:]
        if kinds[k] == kinds[seed] and _alike(tree, kinds, x[k] + environment, types, spacing)
    )
    vectors = _shortest(translations, dim, spacing)
    if vectors is None:
        place = ", ".join(f"{c:.6g}" for c in x[seed])
        order = "; their types must be in order near the planes" if np.ptp(kinds) else ""
        raise BackendError(f"the atoms around ({place}) form no crystal{order}")
    crystal = _with_basis(x, kinds, vectors, x[seed], spacing)
    if crystal.misfit(x[around]).max() > SAME * spacing:
        place = ", ".join(f"{c:.6g}" for c in x[seed])
        raise BackendError(f"the atoms around ({place}) form no crystal: sites of it are empty")
    return crystal


def _alike(tree: cKDTree, kinds: Ints, places: Floats, types: Ints, spacing: float) -> bool:
    """Whether there are atoms of these types at these places."""
    distance, partner = tree.query(places)
    return bool((distance < SAME * spacing).all() and (kinds[partner] == types).all())


def _shortest(translations: Iterable[Floats], dim: int, spacing: float) -> Floats | None:
    """Primitive vectors: the shortest independent ones, of translations in ascending length.

    In up to three dimensions they are a basis of the lattice.
    """
    chosen: list[Floats] = []
    for t in translations:
        if np.linalg.matrix_rank(np.array([*chosen, t]), tol=0.05 * spacing) > len(chosen):
            chosen.append(t)
        if len(chosen) == dim:
            vectors = np.array(chosen)
            vectors[np.abs(vectors) < 1e-9 * spacing] = 0.0
            if np.linalg.det(vectors) < 0.0:
                vectors[-1] *= -1.0
            return vectors
    return None


def _with_basis(x: Floats, kinds: Ints, vectors: Floats, origin: Floats, spacing: float) -> Crystal:
    """The crystal with all atoms of its primitive cell."""
    n = (x - origin) @ np.linalg.inv(vectors)
    near = np.flatnonzero(np.linalg.norm(x - origin, axis=1) < 2.0 * np.abs(vectors).sum())
    basis: list[Floats] = []
    types: list[int] = []
    for k in near[np.argsort(np.linalg.norm(x[near] - origin, axis=1), kind="stable")]:
        place = (n[k] - np.floor(n[k] + SAME)) @ vectors
        if all(_apart(place - other, vectors) > SAME * spacing for other in basis):
            basis.append(place)
            types.append(int(kinds[k]))
    return Crystal(vectors, origin, np.array(basis), np.array(types))


def _apart(difference: Floats, vectors: Floats) -> float:
    """Distance of two sites, up to a translation."""
    n = difference @ np.linalg.inv(vectors)
    return float(np.linalg.norm((n - np.rint(n)) @ vectors))


def _divisor(a: float, b: float, tolerance: float) -> float:
    """Largest common divisor of two lengths."""
    while b > tolerance:
        a, b = b, a % b
        b = 0.0 if a - b < tolerance else b
    return a

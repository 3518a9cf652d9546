"""Plane lattices with one atom in the primitive cell: vectors, neighbours, layers.

Vectors are rows: the sites are ``origin + n @ vectors`` for all pairs n of integers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimpmd_schemas.arrays import Bools, Floats

ON_SITE = 1e-6
"""Distance from a site, in spacings, up to which an atom is at the site."""

SPARSEST = 0.1
"""Least distance between layers, over the square root of the area per atom."""

_PARALLEL = 1e-3
"""Sine of the angle below which two vectors count as parallel."""


def primitive(differences: Floats) -> Floats | None:
    """Two shortest independent vectors of a lattice, shape ``(2, 2)``: a reduced basis.

    Parameters
    ----------
    differences : ndarray, shape ``(n, 2)``
        Vectors from one site to those around it (length).

    Returns
    -------
    ndarray or None
        Among equally short vectors the first is the one closest to the x axis, and the second is
        the next anticlockwise. None if all vectors are parallel.
    """
    length = np.hypot(*differences.T)
    upward = np.arctan2(differences[:, 1], differences[:, 0])
    upward = np.where(upward > -1e-9, np.abs(upward), np.inf)  # one of each opposite pair
    first = _first_of_shortest(length, upward, length > 0.0)
    if first is None:
        return None
    x, y = differences[first]
    across = x * differences[:, 1] - y * differences[:, 0]
    along = differences @ differences[first]
    left = across > _PARALLEL * length * length[first]
    second = _first_of_shortest(length, np.arctan2(across, along), left)
    return None if second is None else differences[[first, second]]


def _first_of_shortest(length: Floats, angle: Floats, allowed: Bools) -> int | None:
    """Row of the least angle among the shortest allowed vectors, which agree to ``ON_SITE``."""
    allowed = allowed & np.isfinite(angle)
    if not allowed.any():
        return None
    shortest = allowed & (length <= length[allowed].min() * (1.0 + ON_SITE))
    return int(np.argmin(np.where(shortest, angle, np.inf)))


def area(vectors: Floats) -> float:
    """Area of the primitive cell."""
    return float(abs(np.linalg.det(vectors)))


@dataclass(frozen=True)
class Lattice:
    """Sites ``origin + n @ vectors`` (length)."""

    vectors: Floats
    origin: Floats

    def numbers(self, x: Floats) -> Floats:
        """Integers n of the sites closest to positions, shape ``(m, 2)``."""
        return np.asarray(np.rint((x - self.origin) @ np.linalg.inv(self.vectors)), float)

    def misfit(self, x: Floats) -> Floats:
        """Distances of positions ``(m, 2)`` from the closest sites, in spacings."""
        away = x - self.origin - self.numbers(x) @ self.vectors
        return np.asarray(np.hypot(*away.T) / self.spacing)

    @property
    def spacing(self) -> float:
        """Square root of the area per atom (length)."""
        return area(self.vectors) ** 0.5


def half_star(vectors: Floats, cutoff: float) -> Floats:
    """Vectors to the neighbours within a cutoff, one of each opposite pair; shortest first.

    Parameters
    ----------
    vectors : ndarray, shape ``(2, 2)``
        A reduced basis.

    Returns
    -------
    ndarray, shape ``(m, 2)``
        Vectors with ``y > 0``, or with ``y = 0`` and ``x > 0``.
    """
    # in a reduced basis |n @ vectors| is at least sqrt(3)/2 of the longer of its two parts
    most = int(2.0 / 3.0**0.5 * cutoff / np.hypot(*vectors.T).min()) + 1
    n = np.arange(-most, most + 1)
    R = np.stack(np.meshgrid(n, n, indexing="ij"), axis=-1).reshape(-1, 2) @ vectors
    length = np.hypot(*R.T)
    flat = np.abs(R[:, 1]) < ON_SITE * length
    R = R[(length < cutoff) & np.where(flat, R[:, 0] > 0.0, R[:, 1] > 0.0)]
    length = np.hypot(*R.T)
    order = np.lexsort((np.arctan2(R[:, 1], R[:, 0]), np.round(length / cutoff / ON_SITE)))
    return R[order]


def layer_spacing(vectors: Floats, axis: int) -> float:
    """Distance between layers of sites normal to an axis; ``inf`` if there are no layers.

    It follows from Euclid's algorithm for the components of the two vectors along the axis.
    """
    size = area(vectors) ** 0.5
    parts = np.abs(vectors[:, axis])
    a, b = float(parts.max()), float(parts.min())
    while b > ON_SITE * size:
        a, b = b, abs(a - b * round(a / b))
    if a < SPARSEST * size:
        return float("inf")
    counts = np.round(parts / a)
    return float(parts @ counts / (counts @ counts))

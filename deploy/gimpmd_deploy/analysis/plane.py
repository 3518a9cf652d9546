"""The plane of a crack or of slip: coordinates along and across it, and the atoms that face it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from gimpmd_schemas.arrays import Floats, Ints

FIRST_SHELL = 1.2
"""Range of the neighbours across the plane, in distances of nearest neighbours.

It lies between the first and the second shell of the usual lattices.
"""


@dataclass(frozen=True)
class Plane:
    """A line through a body in two dimensions, or a plane in three, in the reference state.

    Attributes
    ----------
    origin : ndarray, shape ``(d,)``
        A point of the plane, from which positions along it are measured.
    along, normal : ndarray, shape ``(d,)``
        Unit vectors: the direction of growth or slip, and the normal, which points to the side
        called *above*. In two dimensions the normal is ``along`` turned left.
    """

    origin: Floats
    along: Floats
    normal: Floats

    @classmethod
    def through(cls, origin: ArrayLike, along: ArrayLike, normal: ArrayLike | None = None) -> Plane:
        """Make the plane through a point.

        Parameters
        ----------
        origin, along : array_like, shape ``(d,)``
            ``along`` need not be a unit vector.
        normal : array_like, shape ``(3,)``, optional
            Required in three dimensions; its part along ``along`` is removed.

        Raises
        ------
        ValueError
            The direction is zero, or the normal is missing in three dimensions.
        """
        start, e1 = np.asarray(origin, dtype=float), np.asarray(along, dtype=float)
        length = float(np.linalg.norm(e1))
        if length == 0.0:
            raise ValueError("the direction along the plane is zero")
        e1 = e1 / length
        if normal is None:
            if e1.size != 2:
                raise ValueError("a plane in three dimensions needs its normal")
            return cls(start, e1, np.array([-e1[1], e1[0]]))
        e2 = np.asarray(normal, dtype=float)
        e2 = e2 - (e2 @ e1) * e1
        return cls(start, e1, e2 / np.linalg.norm(e2))

    def position(self, x: Floats) -> Floats:
        """Distance of positions ``(n, d)`` from the origin along the plane, shape ``(n,)``."""
        return np.asarray((x - self.origin) @ self.along)

    def height(self, x: Floats) -> Floats:
        """Distance of positions ``(n, d)`` above the plane, negative below, shape ``(n,)``."""
        return np.asarray((x - self.origin) @ self.normal)


class Bonds(NamedTuple):
    """Pairs of atoms that are nearest neighbours across a plane in the reference state."""

    above: Ints
    below: Ints


def bonds_across(plane: Plane, reference: Floats, spacing: float) -> Bonds:
    """Find all pairs of nearest neighbours on different sides of a plane.

    Parameters
    ----------
    reference : ndarray, shape ``(n, d)``
        Lattice sites.
    spacing : float
        Distance of nearest neighbours.

    Returns
    -------
    Bonds
        Indices of the atoms; each array has one entry for each pair.
    """
    height, reach = plane.height(reference), FIRST_SHELL * spacing
    above = np.flatnonzero((height >= 0.0) & (height < reach))
    below = np.flatnonzero((height < 0.0) & (height > -reach))
    if above.size == 0 or below.size == 0:
        return Bonds(above[:0], below[:0])
    tree = cKDTree(reference[below])
    found = tree.query_ball_point(reference[above], reach)
    counts = [len(one) for one in found]
    return Bonds(np.repeat(above, counts), below[np.concatenate(found).astype(np.int64)])

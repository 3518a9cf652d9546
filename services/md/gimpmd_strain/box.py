"""Boxes and configurations of atoms, in two or three dimensions.

A box may be tilted, and it may be periodic along each of its edges.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimpmd_schemas.arrays import Bools, Floats


@dataclass(frozen=True)
class Box:
    """A simulation box.

    Attributes
    ----------
    origin : ndarray, shape ``(d,)``
        Lower corner (length units).
    edges : ndarray, shape ``(d, d)``
        The edge vectors, one per column.
    periodic : ndarray of bool, shape ``(d,)``
        Whether the body repeats along each edge.
    """

    origin: Floats
    edges: Floats
    periodic: Bools

    @classmethod
    def of_lammps(
        cls, low: Floats, high: Floats, tilts: Floats, periodic: Bools, dimension: int
    ) -> Box:
        """Take the first ``dimension`` axes of a LAMMPS box; ``tilts`` are xy, xz and yz."""
        edges = np.diag(np.subtract(high, low))
        edges[0, 1], edges[0, 2], edges[1, 2] = tilts
        axes = slice(dimension)
        return cls(np.array(low[axes]), edges[axes, axes].copy(), np.array(periodic[axes], bool))

    def fractions(self, x: Floats) -> Floats:
        """Convert positions ``(n, d)`` to units of the edges, relative to the lower corner."""
        return (x - self.origin) @ np.linalg.inv(self.edges).T

    def heights(self) -> Floats:
        """Distances of opposite faces, shape ``(d,)``."""
        return 1.0 / np.linalg.norm(np.linalg.inv(self.edges), axis=1)

    def continued(self, before: Box) -> Box:
        """Describe the same box so that its change from an earlier box is the change of the body.

        Free axes keep their earlier edge and corner, since LAMMPS shrinks free faces around the
        atoms. Several tilts give the same periodic images, and LAMMPS flips a box that is tilted
        too far; the tilt nearest to the earlier one is taken.
        """
        edges = np.where(self.periodic, self.edges, before.edges)
        for j in range(1, len(edges)):
            for i in reversed(range(j)):
                if self.periodic[i] and self.periodic[j]:
                    flips = np.round((before.edges[i, j] - edges[i, j]) / edges[i, i])
                    edges[:, j] += flips * edges[:, i]
        return Box(np.where(self.periodic, self.origin, before.origin), edges, self.periodic)


@dataclass(frozen=True)
class Configuration:
    """Positions of atoms at one time: the box, and unwrapped positions of shape ``(n, d)``."""

    box: Box
    x: Floats


def halfway(a: Configuration, b: Configuration) -> Configuration:
    """Average two configurations of the same atoms."""
    box = Box(
        0.5 * (a.box.origin + b.box.origin), 0.5 * (a.box.edges + b.box.edges), a.box.periodic
    )
    return Configuration(box, 0.5 * (a.x + b.x))


def unwrapped(x: Floats, box: Box, near: Configuration) -> Floats:
    """Choose the periodic images of atoms that are nearest to their positions in ``near``."""
    jump = box.fractions(x) - near.box.fractions(near.x)
    return x - (np.where(box.periodic, np.round(jump), 0.0)) @ box.edges.T

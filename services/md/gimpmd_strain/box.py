"""Boxes and configurations of atoms: two or three dimensions, tilted or not, periodic or not."""

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
        Which edges the body repeats along.
    """

    origin: Floats
    edges: Floats
    periodic: Bools

    @classmethod
    def of_lammps(
        cls, low: Floats, high: Floats, tilts: Floats, periodic: Bools, dimension: int
    ) -> Box:
        """The first ``dimension`` axes of a LAMMPS box; ``tilts`` are xy, xz, yz."""
        edges = np.diag(np.subtract(high, low))
        edges[0, 1], edges[0, 2], edges[1, 2] = tilts
        axes = slice(dimension)
        return cls(np.array(low[axes]), edges[axes, axes].copy(), np.array(periodic[axes], bool))

    def fractions(self, x: Floats) -> Floats:
        """Positions in units of the edges, from the lower corner; shape ``(n, d)``."""
        return (x - self.origin) @ np.linalg.inv(self.edges).T

    def heights(self) -> Floats:
        """Distances of opposite faces, shape ``(d,)``."""
        return 1.0 / np.linalg.norm(np.linalg.inv(self.edges), axis=1)

    def continued(self, before: Box) -> Box:
        """The same box, described so that its change from an earlier one is the body's.

        Free axes keep their edge and corner, since LAMMPS wraps free faces around the atoms; and
        of the tilts that make the same lattice of images the nearest is taken, since LAMMPS flips
        a box that is tilted too far.
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
    """Where atoms are at one time: the box, and their unwrapped positions, shape ``(n, d)``."""

    box: Box
    x: Floats


def halfway(a: Configuration, b: Configuration) -> Configuration:
    """The configuration midway between two of the same atoms."""
    box = Box(
        0.5 * (a.box.origin + b.box.origin), 0.5 * (a.box.edges + b.box.edges), a.box.periodic
    )
    return Configuration(box, 0.5 * (a.x + b.x))


def unwrapped(x: Floats, box: Box, near: Configuration) -> Floats:
    """Of the periodic images of atoms those nearest to where they were in another configuration."""
    jump = box.fractions(x) - near.box.fractions(near.x)
    return x - (np.where(box.periodic, np.round(jump), 0.0)) @ box.edges.T

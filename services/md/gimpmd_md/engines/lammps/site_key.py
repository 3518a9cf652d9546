"""Atoms known by their lattice positions, whatever ids LAMMPS has given them."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.case.form import Domain

SAME_SITE = 1e-3
"""Distance up to which lattice positions are the same, in distances of nearest neighbours."""


class SiteKey:
    """Finds atoms by their lattice positions.

    Parameters
    ----------
    site : ndarray, shape ``(n, d)``
        Lattice positions of the atoms of this rank.
    domain : Domain
    distance : float
        Distance of nearest neighbours.
    """

    def __init__(self, site: Floats, domain: Domain, distance: float) -> None:
        self._domain, self._distance = domain, distance
        self._tree = cKDTree(self._wrapped(site))

    def rows(self, site: Floats) -> tuple[Ints, Bools]:
        """Rows ``(m,)`` of the atoms with such positions, and which positions have one."""
        if not self._tree.n:
            return np.empty(0, dtype=np.int64), np.zeros(len(site), dtype=np.bool_)
        away, rows = self._tree.query(self._wrapped(site))
        here = away < SAME_SITE * self._distance
        return rows[here], here

    def _wrapped(self, site: Floats) -> Floats:
        """Positions inside periodic faces; those on a face come to one side of it."""
        site, margin = site.copy(), SAME_SITE * self._distance
        for axis, (low, high) in enumerate(self._domain.box):
            if self._domain.periodic[axis]:
                site[:, axis] = (site[:, axis] - low + margin) % (high - low)
        return site

"""The file with which the MD service hands the stiffness of its atoms over to the continuum."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import sparse

from gimpmd_schemas.arrays import Floats

MOST = {2: 50_000, 3: 12_000}
"""Freedoms of atoms and nodes up to which modes are looked at, by the number of dimensions."""


@dataclass(frozen=True, eq=False)
class Stiffness:
    """Second derivatives of the energy of the active sites, in free atoms and nodes.

    Attributes
    ----------
    x : ndarray, shape ``(n, d)``
        Sites of the free atoms (length).
    matrix : sparse matrix in rows, shape ``((n + nodes) d, (n + nodes) d)``
        The components of the free atoms, then those of all nodes of the shared grid (mechanical
        units).
    """

    x: Floats
    matrix: sparse.csr_array

    def save(self, path: Path) -> None:
        """Write it as an uncompressed ``.npz``."""
        m = self.matrix
        np.savez(path, x=self.x, data=m.data, indices=m.indices, starts=m.indptr)

    @classmethod
    def load(cls, path: Path) -> Stiffness:
        """Read what `save` has written."""
        with np.load(path) as file:
            size = len(file["starts"]) - 1
            parts = file["data"], file["indices"], file["starts"]
            return cls(file["x"], sparse.csr_array(parts, shape=(size, size)))

"""Which nodes have weights in a matrix."""

from __future__ import annotations

import numpy as np

from gimpmd_gimp.coupling.interface.weights import Sparse
from gimpmd_schemas.arrays import Bools

ROUNDING = 1e-12
"""Weights below this, over the largest, are round-off."""


def touched(*matrices: Sparse) -> Bools:
    """Tell which nodes, the columns, have a weight in one of the matrices; shape ``(nodes,)``."""
    found = np.zeros(matrices[0].shape[1], dtype=np.bool_)
    for matrix in matrices:
        size = abs(matrix).sum(axis=0)
        found |= size > ROUNDING * size.max(initial=0.0)
    return found

"""The nodes of a GIMP solver on the grid that both sides share."""

from __future__ import annotations

import numpy as np

from gimpmd_gimp.step.solver import Solver
from gimpmd_schemas.arrays import Ints
from gimpmd_schemas.grid.background import PAD, BackgroundGrid


def find_nodes(solver: Solver, grid: BackgroundGrid, ids: Ints) -> Ints:
    """Rows of the nodal arrays for ids of the shared grid; -1 for nodes of other ranks."""
    coords = np.stack(np.unravel_index(ids, grid.shape), axis=1) - PAD
    return solver.mesh.find(solver.top, coords)

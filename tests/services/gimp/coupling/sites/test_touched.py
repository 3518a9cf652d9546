"""Nodes that have weights."""

from __future__ import annotations

import numpy as np

from gimpmd_gimp.coupling.interface.weights import hats
from gimpmd_gimp.coupling.sites.touched import touched
from gimpmd_schemas.grid.background import BackgroundGrid

GRID = BackgroundGrid((0.0, 0.0, 0.0), 2.0, (4, 4, 5), (False, False, False))


def test_touched_nodes_have_more_than_round_off() -> None:
    weights = hats(GRID, np.array([[2.0, 4.0 + 1e-13, 5.0]]))
    assert touched(weights).sum() == 2

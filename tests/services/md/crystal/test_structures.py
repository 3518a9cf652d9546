"""Cells of crystal structures, also with turned axes."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest
from scipy.spatial import cKDTree

from gimpmd_md.crystal.structures import CELLS, atoms
from gimpmd_schemas.wire.lattice import Structure

NEIGHBOURS = {"sc": 6, "bcc": 8, "fcc": 12, "diamond": 4, "hcp": 12, "hex": 6, "sq": 4}


@pytest.mark.parametrize("structure", get_args(Structure))
def test_all_cells_of_a_structure_are_the_same_crystal(structure: Structure) -> None:
    """Whatever the axes: the same volume for each atom, and the number of nearest neighbours."""
    cell = CELLS[structure]
    volume = np.prod(cell.edges) / len(cell.basis)
    for axes in {plane.axes for plane in cell.planes}:
        edges, x = atoms(structure, axes)
        assert np.prod(edges) / len(x) == pytest.approx(volume)
        copies = np.stack(np.meshgrid(*[(-2, -1, 0, 1, 2)] * len(edges)), -1)
        everywhere = (x[:, None] + copies.reshape(-1, len(edges)) * edges).reshape(-1, len(edges))
        near = cKDTree(everywhere)
        least = near.query(x, k=2)[0][:, 1].min()
        counts = near.query_ball_point(x, 1.001 * least, return_length=True) - 1
        assert set(counts.tolist()) == {NEIGHBOURS[structure]}

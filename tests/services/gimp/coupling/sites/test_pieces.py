"""Cells cut at the planes."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.coupling.sites.pieces import Pieces, cut_cells
from gimpmd_gimp.coupling.sites.shells import Shells
from gimpmd_schemas.grid.background import BackgroundGrid

GRID = BackgroundGrid((-2.0, 1.0, 0.0), 1.5, (4, 3, 3), (False, False, False))
SHELLS = Shells(
    ((((-0.4, 1.1), (2.3, 3.1), (1.0, 2.2))),), ((((-1.0, 1.7), (1.6, 3.7), (0.4, 2.9))),)
)


@pytest.fixture(scope="module")
def pieces() -> Pieces:
    return cut_cells(GRID, SHELLS)


def test_pieces_fill_the_grid_and_the_boxes(pieces: Pieces) -> None:
    for chosen, box in (
        (np.ones(len(pieces.x), bool), ((0.0, 6.0), (0.0, 4.5), (0.0, 4.5))),
        (pieces.free, SHELLS.free[0]),
        (pieces.active, SHELLS.active[0]),
    ):
        assert pieces.volume[chosen].sum() == pytest.approx(np.prod(np.ptp(box, axis=1)))


def test_shares_of_pieces_fill_a_box(pieces: Pieces) -> None:
    """The second box lies in the first one, and counts no volume twice."""
    box = (-0.7, 1.3), (2.1, 3.3), (0.9, 2.3)
    share = pieces.share([box, SHELLS.free[0]], GRID.cell)
    assert 0.0 <= share.min() <= share.max() <= 1.0
    assert share @ pieces.volume == pytest.approx(np.prod(np.ptp(box, axis=1)))


def test_no_plane_or_node_line_cuts_a_piece(pieces: Pieces) -> None:
    low, high = pieces.x - 1.5 * pieces.half, pieces.x + 1.5 * pieces.half
    for axis in range(3):
        nodes = GRID.origin[axis] + 1.5 * np.arange(GRID.cells[axis] + 1)
        for line in (*SHELLS.lines(axis), *nodes):
            crossed = (low[:, axis] < line - 1e-9) & (high[:, axis] > line + 1e-9)
            assert not crossed.any()


def test_slopes_give_the_gradient_of_a_linear_field(pieces: Pieces) -> None:
    field = GRID.positions() @ [1.0, -2.0, 3.0]
    for slope, value in zip(pieces.slopes(GRID), (1.0, -2.0, 3.0), strict=True):
        np.testing.assert_allclose(slope @ field, value, atol=1e-12)

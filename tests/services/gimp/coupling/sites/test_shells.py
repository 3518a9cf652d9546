"""Regions within the planes."""

from __future__ import annotations

import numpy as np

from gimpmd_gimp.coupling.sites.shells import Face, Shells, depth, faces_met, grown, inside
from gimpmd_schemas.grid.background import BackgroundGrid

L = (((0.0, 4.0), (0.0, 2.0)), ((0.0, 2.0), (0.0, 4.0)))
"""Two boxes that make an L."""


def test_depth_in_a_union_of_boxes() -> None:
    x = np.array([[1.0, 1.0], [3.5, 1.0], [3.0, 3.0], [-1.0, 1.0], [5.0, 4.0]])
    np.testing.assert_allclose(depth(L, x), [1.0, 0.5, -1.0, -1.0, -2.0])
    np.testing.assert_array_equal(inside(L, x), [True, True, False, False, False])


def test_lines_and_growth() -> None:
    shells = Shells(L, grown(L, 1.0))
    np.testing.assert_array_equal(shells.lines(1), [-1.0, 0.0, 2.0, 3.0, 4.0, 5.0])


def test_faces_at_which_planes_end() -> None:
    grid = BackgroundGrid((0.0, -4.0), 1.0, (8, 8), (False, False))
    corner = (((-np.inf, 3.0), (-np.inf, 2.0)),)
    assert faces_met(grid, Shells(corner, corner)) == [Face(0, 0.0), Face(1, -4.0)]
    strip = (((-np.inf, 3.0), (-np.inf, np.inf)),)  # its plane ends at two faces, and meets none
    assert faces_met(grid, Shells(strip, strip)) == [Face(1, -4.0), Face(1, 4.0)]
    around = BackgroundGrid((0.0, -4.0), 1.0, (8, 8), (False, True))
    assert faces_met(around, Shells(strip, strip)) == []

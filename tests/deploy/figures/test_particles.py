"""Particles in the x-y plane."""

import numpy as np
import pytest

from gimpmd_deploy.figures.particles import draw_particles, in_slice
from gimpmd_deploy.figures.style import pyplot
from tests.deploy.figures.three_d import lattice


def test_a_slice_of_three_dimensions():
    cubes = lattice(2.0, ((0.0, 4.0), (0.0, 4.0), (0.0, 8.0)))
    cut = in_slice(cubes, 3.5)
    assert np.unique(cut.position[:, 2]).tolist() == [3.0]
    assert len(cut) == 4


def test_two_dimensions_are_a_slice():
    squares = lattice(2.0, ((0.0, 4.0), (0.0, 4.0)))
    assert in_slice(squares, 99.0) is squares


@pytest.mark.parametrize("cover", [True, False])
def test_points_and_atoms_are_drawn(cover):
    figure, axes = pyplot().subplots()
    squares = lattice(2.0, ((0.0, 4.0), (0.0, 4.0)))
    colours = draw_particles(axes, squares, lattice(1.0, ((4.0, 6.0), (0.0, 4.0))), 3.0, cover)
    assert colours.get_clim() == (-3.0, 3.0)
    rectangles, discs = axes.collections
    assert (len(rectangles.get_paths()), len(discs.get_offsets())) == (4, 8)
    pyplot().close(figure)

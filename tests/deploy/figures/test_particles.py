"""Particles in the x-y plane: one by one where they are large, as an image where they are small."""

import numpy as np
import pytest

from gimpmd_deploy.figures.body import frame
from gimpmd_deploy.figures.colours import Scale
from gimpmd_deploy.figures.particles import draw_atoms, draw_points, draw_rings, in_slice
from gimpmd_deploy.figures.style import pyplot
from tests.deploy.figures.three_d import lattice

SCALE = Scale(-3.0, 3.0, "RdBu_r")


@pytest.fixture
def axes():
    """Axes of 400 pixels for a square of edge 40."""
    figure = pyplot().figure(figsize=(4.0, 4.0), dpi=100, layout="none")
    found = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    frame(found, ((0.0, 40.0), (0.0, 40.0)), margin=False)
    yield found
    pyplot().close(figure)


def named(edge, box):
    particles = lattice(edge, box)
    particles.fields["f"] = particles.stress[:, 1]
    return particles


def test_a_slice_of_three_dimensions():
    cubes = lattice(2.0, ((0.0, 4.0), (0.0, 4.0), (0.0, 8.0)))
    cut = in_slice(cubes, 3.5)
    assert np.unique(cut.position[:, 2]).tolist() == [3.0]
    assert len(cut) == 4


def test_a_slice_between_layers_of_a_stretched_body_is_not_empty():
    cubes = lattice(2.0, ((0.0, 4.0), (0.0, 4.0), (0.0, 8.0)))
    cubes.position[:, 2] = 4.0 + 1.01 * (cubes.position[:, 2] - 4.0)
    assert len(in_slice(cubes, 4.0)) == 8


def test_two_dimensions_are_a_slice():
    squares = lattice(2.0, ((0.0, 4.0), (0.0, 4.0)))
    assert in_slice(squares, 99.0) is squares


def test_large_particles_are_drawn_one_by_one(axes):
    draw_points(axes, named(2.0, ((0.0, 4.0), (0.0, 4.0))), "f", SCALE)
    draw_atoms(axes, named(1.0, ((4.0, 6.0), (0.0, 4.0))), "f", SCALE)
    draw_rings(axes, named(1.0, ((6.0, 7.0), (0.0, 4.0))))
    rectangles, discs, rings = axes.collections
    assert (len(rectangles.get_paths()), len(discs.get_offsets()), len(rings.get_offsets())) == (
        *(4, 8, 4),
    )
    assert rectangles.get_clim() == discs.get_clim() == (-3.0, 3.0)


@pytest.mark.parametrize("draw", [draw_points, draw_atoms])
def test_small_particles_are_drawn_as_an_image_without_holes(axes, draw):
    """Also where the body is stretched by 4 %."""
    particles = named(0.3, ((0.0, 30.0), (0.0, 24.0)))
    particles.position[:] *= 1.04
    draw(axes, particles, "f", SCALE)
    (image,) = axes.images
    values = image.get_array()
    inside = values[2:-155, 2:-95]
    assert not np.ma.getmaskarray(inside).any()
    columns = np.arange(2, values.shape[1] - 95) + 0.5
    expected = np.broadcast_to(0.1 * columns / 1.04, inside.shape)
    np.testing.assert_allclose(inside, expected, atol=0.35)
    draw_rings(axes, particles)
    assert not axes.collections


def test_particles_without_the_field_are_grey(axes):
    draw_points(axes, lattice(2.0, ((0.0, 4.0), (0.0, 4.0))), "f", SCALE)
    draw_atoms(axes, lattice(0.3, ((4.0, 6.0), (0.0, 4.0))), "f", SCALE)
    assert axes.collections[0].get_array() is None
    assert axes.images[0].get_cmap().N == 1
    draw_points(axes, None, "f", SCALE)
    draw_atoms(axes, None, "f", SCALE)
    assert len(axes.images) == len(axes.collections) == 1

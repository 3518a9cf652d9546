"""Images of the means of particles."""

import numpy as np

from gimpmd_deploy.figures.raster import mean_image


def test_rectangles_cover_the_pixels_whose_centres_they_contain():
    image = mean_image(
        np.array([[0.0, 0.0], [1.6, 0.4]]),
        np.array([[1.5, 1.5], [3.0, 2.4]]),
        np.array([1.0, 3.0]),
        (3, 4),
    )
    nan = np.nan
    np.testing.assert_array_equal(image, [[1, nan, 3, nan], [nan, nan, 3, nan], [nan] * 4])


def test_tiny_particles_are_averaged():
    rng = np.random.default_rng(0)
    x = rng.uniform(0.0, 5.0, size=(4000, 2))
    values = rng.normal(size=4000)
    image = mean_image(x - 1e-3, x + 1e-3, values, (5, 5))
    sums = np.histogram2d(x[:, 1], x[:, 0], bins=5, range=[[0, 5]] * 2, weights=values)[0]
    counts = np.histogram2d(x[:, 1], x[:, 0], bins=5, range=[[0, 5]] * 2)[0]
    np.testing.assert_allclose(image, sums / counts)


def test_overlapping_particles_are_averaged_and_others_left_out():
    low = np.array([[-1.0, -1.0], [0.0, 0.0], [7.0, 7.0]])
    image = mean_image(low, low + 2.0, np.array([1.0, 2.0, 9.0]), (2, 2))
    np.testing.assert_array_equal(image, [[1.5, 2.0], [2.0, 2.0]])

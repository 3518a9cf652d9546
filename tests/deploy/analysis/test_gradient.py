"""Displacement gradient of atoms in made-up fields."""

import numpy as np
import pytest

from gimpmd_deploy.analysis.crack import Crack
from gimpmd_deploy.analysis.gradient import Neighbours, displacement_gradient
from tests.deploy.analysis.fields import SPACING, hexagonal

SITES = hexagonal(((0, 30), (-10, 10)))
NEIGHBOURS = Neighbours.of(SITES, SPACING)
H = np.array([[0.01, -0.02], [0.03, 0.005]])


def test_uniform_gradient_is_exact_also_at_the_surface():
    found = displacement_gradient(NEIGHBOURS, SITES @ H.T + (3.0, 4.0))
    assert np.abs(found - H).max() < 1e-12


def test_the_jump_across_an_open_crack_does_not_count():
    u = SITES @ H.T
    u[:, 1] += 2.0 * (SITES[:, 1] > 0) * (SITES[:, 0] < 20)
    found = displacement_gradient(NEIGHBOURS, u)
    away = np.abs(SITES[:, 0] - 20) > 2.0 * SPACING
    assert np.abs(found - H)[away].max() < 1e-12


def test_closed_faces_of_a_crack_do_not_count():
    u = SITES @ H.T
    u[:, 1] += 0.05 * (SITES[:, 1] > 0) * (SITES[:, 0] < 20)
    crack = Crack.between((0, 0), (20, 0))
    found = displacement_gradient(Neighbours.of(SITES, SPACING, crack), u)
    away = np.abs(SITES[:, 0] - 20) > 2.0 * SPACING
    assert np.abs(found - H)[away].max() < 1e-12
    assert np.abs(displacement_gradient(NEIGHBOURS, u) - H)[away].max() > 0.01


def test_the_error_in_a_wave_is_that_of_a_central_difference():
    k = 2 * np.pi / 20.0
    u = np.stack([0.1 * np.sin(k * SITES[:, 0]), 0.0 * SITES[:, 0]], axis=1)
    inside = (np.abs(SITES[:, 0] - 15) < 12) & (np.abs(SITES[:, 1]) < 8)
    exact = 0.1 * k * np.cos(k * SITES[inside, 0])
    error = displacement_gradient(NEIGHBOURS, u)[inside, 0, 0] - exact
    # hexagonal neighbours: sum of the fourth powers over the second, times k^2 / 6
    assert np.abs(error).max() == pytest.approx(0.1 * k * (k * SPACING) ** 2 / 8.0, rel=0.05)


def test_atoms_without_neighbours():
    sites = np.array([[0.0, 0.0], [10.0, 0.0], [10.0 + SPACING, 0.0]])
    assert not displacement_gradient(Neighbours.of(sites, SPACING), sites).any()

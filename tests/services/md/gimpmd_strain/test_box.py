"""Boxes of atoms: fractions, flips of the tilt, and periodic images."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from gimpmd_strain.box import Box, Configuration, halfway, unwrapped

ALL = np.ones(3, dtype=bool)
TILTED = np.array([[4.0, 1.0, -0.5], [0.0, 3.0, 0.7], [0.0, 0.0, 2.0]])


def box(edges, periodic=True, origin=0.0) -> Box:
    edges = np.array(edges, dtype=float)
    d = len(edges)
    return Box(np.full(d, origin), edges, np.broadcast_to(periodic, d).copy())


def test_the_axes_of_a_lammps_box() -> None:
    low, high, tilts = np.array([1.0, 2.0, -0.5]), np.array([5.0, 5.0, 1.5]), [1.0, -0.5, 0.7]
    solid = Box.of_lammps(low, high, tilts, [True, False, True], 3)
    np.testing.assert_array_equal(solid.edges, TILTED)
    np.testing.assert_array_equal(solid.origin, low)
    assert solid.periodic.tolist() == [True, False, True]
    plane = Box.of_lammps(low, high, tilts, [True, False, True], 2)
    np.testing.assert_array_equal(plane.edges, TILTED[:2, :2])
    assert plane.periodic.tolist() == [True, False]


def test_fractions_are_in_units_of_the_edges() -> None:
    made = box(TILTED, origin=0.3)
    fractions = np.random.default_rng(0).uniform(-1.0, 2.0, (20, 3))
    x = 0.3 + sum(fractions[:, [j]] * TILTED[:, j] for j in range(3))
    np.testing.assert_allclose(made.fractions(x), fractions, atol=1e-13)


def test_heights_are_the_distances_of_opposite_faces() -> None:
    """Volume over the area of the face, which is a cross product of two edges."""
    a, b, c = TILTED.T
    volume = a @ np.cross(b, c)
    expected = [volume / np.linalg.norm(np.cross(*pair)) for pair in ((b, c), (c, a), (a, b))]
    np.testing.assert_allclose(box(TILTED).heights(), expected, rtol=1e-13)
    np.testing.assert_allclose(box([[4.0, 3.0], [0.0, 3.0]]).heights(), [4.0 / 2**0.5, 3.0])


@pytest.mark.parametrize("flips", list(product((-2, 0, 1), repeat=3)))
def test_a_box_that_lammps_flips_goes_on_shearing(flips) -> None:
    """Any whole multiples of edges added to later ones leave the same periodic images."""
    later = TILTED + np.array([[0.1, 0.2, -0.1], [0.0, 0.05, 0.1], [0.0, 0.0, -0.2]])
    flipped = later.copy()
    flipped[:, 1] += flips[0] * later[:, 0]
    flipped[:, 2] += flips[1] * later[:, 0] + flips[2] * later[:, 1]
    found = box(flipped).continued(box(TILTED))
    np.testing.assert_allclose(found.edges, later, atol=1e-14)


def test_free_axes_keep_their_edge_and_corner() -> None:
    """LAMMPS shrinks free faces around the atoms, which is no change of the body."""
    before = box([[4.0, 0.5], [0.0, 3.0]], [True, False], origin=1.0)
    now = box([[4.2, 0.4], [0.0, 2.8]], [True, False], origin=1.1)
    found = now.continued(before)
    np.testing.assert_array_equal(found.edges[0, 0], 4.2)
    np.testing.assert_array_equal(found.edges[:, 1], before.edges[:, 1])
    np.testing.assert_array_equal(found.origin, [1.1, 1.0])


def test_halfway_is_the_average() -> None:
    a = Configuration(box(TILTED), np.zeros((2, 3)))
    b = Configuration(box(3.0 * TILTED, origin=1.0), np.ones((2, 3)))
    middle = halfway(a, b)
    np.testing.assert_allclose(middle.box.edges, 2.0 * TILTED)
    np.testing.assert_allclose(middle.box.origin, 0.5)
    np.testing.assert_allclose(middle.x, 0.5)


def test_atoms_are_followed_across_periodic_faces_only() -> None:
    """They drift by less than half an edge, and the box itself deforms meanwhile."""
    rng = np.random.default_rng(1)
    periodic = np.array([True, True, False])
    start, end = box(TILTED, periodic), box(1.1 * TILTED, periodic, origin=-0.2)
    fractions = rng.uniform(-3.0, 3.0, (30, 3))
    drift = rng.uniform(-0.45, 0.45, (30, 3))
    near = Configuration(start, start.origin + fractions @ start.edges.T)
    exact = end.origin + (fractions + drift) @ end.edges.T
    wrapped = (fractions + drift) - np.where(periodic, np.floor(fractions + drift), 0.0)
    found = unwrapped(end.origin + wrapped @ end.edges.T, end, near)
    np.testing.assert_allclose(found, exact, atol=1e-12)

"""Plane lattices: reduced bases, neighbours, sites and layers, by enumeration."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_md.crystal import bravais
from gimpmd_md.crystal.bravais import Lattice

HEXAGONAL = np.array([[1.0, 0.0], [0.5, 3**0.5 / 2]])
SQUARE = np.eye(2)
OBLIQUE = np.array([[1.0, 0.1], [-0.3, 1.4]])
LATTICES = {"hexagonal": HEXAGONAL, "square": SQUARE, "oblique": OBLIQUE}


def all_vectors(vectors: np.ndarray, most: int = 12) -> np.ndarray:
    n = np.arange(-most, most + 1)
    return np.stack(np.meshgrid(n, n), axis=-1).reshape(-1, 2) @ vectors


def test_reduced_basis() -> None:
    """Of a lattice given by long vectors: the shortest ones, the first close to x."""
    points = all_vectors(np.array([[3.0, 1.0], [2.0, 1.5]]), 8)  # (1, -0.5), (1, 2) are in it
    found = bravais.primitive(points)
    np.testing.assert_allclose(np.sort(np.hypot(*found.T)), [1.25**0.5, 5.0**0.5])
    assert bravais.area(found) == pytest.approx(2.5)
    assert bravais.primitive(np.array([[1.0, 0.0], [-2.0, 0.0]])) is None


@pytest.mark.parametrize(("axis", "spacing"), [(0, 0.5), (1, 3**0.5 / 2)])
def test_distance_of_layers(axis: int, spacing: float) -> None:
    assert bravais.layer_spacing(HEXAGONAL, axis) == pytest.approx(spacing, rel=1e-14)


@pytest.mark.parametrize("turn", [0.0, 0.3, 1.1])
@pytest.mark.parametrize("name", LATTICES)
def test_a_reduced_basis_spans_the_lattice(name: str, turn: float) -> None:
    """Whole numbers both ways, and no vector of the lattice is shorter."""
    c, s = np.cos(turn), np.sin(turn)
    vectors = LATTICES[name] @ np.array([[c, s], [-s, c]])
    points = all_vectors(vectors)
    found = bravais.primitive(points)
    change = found @ np.linalg.inv(vectors)
    np.testing.assert_allclose(change, np.rint(change), atol=1e-12)
    assert abs(np.linalg.det(change)) == pytest.approx(1.0)
    length = np.sort(np.hypot(*points.T))
    assert np.hypot(*found[0]) == pytest.approx(length[1])
    assert found[0][1] >= -1e-9  # upward, or along x
    assert np.linalg.det(found) > 0.0  # the second one is anticlockwise of the first
    assert abs(found[0] @ found[1]) <= 0.5 * (found[0] @ found[0]) * (1.0 + 1e-9)


@pytest.mark.parametrize("cutoff", [1.05, 2.5, 6.0])
@pytest.mark.parametrize("name", LATTICES)
def test_half_of_the_neighbours(name: str, cutoff: float) -> None:
    star = bravais.half_star(LATTICES[name], cutoff)
    points = all_vectors(LATTICES[name])
    length = np.hypot(*points.T)
    around = points[(length > 0.0) & (length < cutoff)]
    both = np.concatenate([star, -star])
    order = np.lexsort(np.round(both, 9).T), np.lexsort(np.round(around, 9).T)
    np.testing.assert_allclose(both[order[0]], around[order[1]], atol=1e-13)
    assert (np.diff(np.hypot(*star.T)) > -1e-9).all()
    assert ((star[:, 1] > 1e-9) | ((np.abs(star[:, 1]) < 1e-9) & (star[:, 0] > 0.0))).all()


def test_sites_and_the_distance_from_them() -> None:
    lattice = Lattice(OBLIQUE, np.array([0.7, -0.2]))
    rng = np.random.default_rng(0)
    numbers = rng.integers(-9, 9, (40, 2))
    sites = lattice.origin + numbers @ OBLIQUE
    off = rng.uniform(-0.1, 0.1, (40, 2))
    np.testing.assert_array_equal(lattice.numbers(sites + off), numbers)
    expected = np.hypot(*off.T) / np.linalg.det(OBLIQUE) ** 0.5
    np.testing.assert_allclose(lattice.misfit(sites + off), expected, rtol=1e-10)
    assert lattice.spacing == pytest.approx(1.43**0.5)


@pytest.mark.parametrize("axis", [0, 1])
def test_layers_are_the_closest_planes_of_sites(axis: int) -> None:
    """Of a lattice turned onto rows of sites along the axes; by all coordinates that occur."""
    vectors = np.array([[2.0, 1.0], [-1.0, 2.0]]) / 5**0.5
    heights = np.unique(np.round(all_vectors(vectors)[:, axis], 9))
    expected = np.diff(heights[np.abs(heights) < 1.0]).min()
    assert bravais.layer_spacing(vectors, axis) == pytest.approx(expected, rel=1e-8)


def test_a_lattice_turned_at_will_has_no_layers() -> None:
    c, s = np.cos(0.4), np.sin(0.4)
    turned = HEXAGONAL @ np.array([[c, s], [-s, c]])
    assert bravais.layer_spacing(turned, 0) == float("inf")

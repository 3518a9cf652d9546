"""Virial strain against its own theory under uniform deformation."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_schemas.errors import InputError
from gimpmd_strain.box import Configuration
from gimpmd_strain.virial import find_neighbours, nearest_distance, virial_strain
from tests.services.md.gimpmd_strain.crystals import crystal, deformed, inside

LATTICES = [("hex", 6), ("sc", 6), ("fcc", 12), ("bcc", 14)]
REPEATS = {"hex": (9, 6), "sc": (6, 5, 7), "fcc": (5, 4, 6), "bcc": (5, 4, 6)}


def almansi_of(H: np.ndarray) -> np.ndarray:
    """``(1 - (F F^T)^-1) / 2``."""
    F = np.eye(len(H)) + H
    return 0.5 * (np.eye(len(H)) - np.linalg.inv(F @ F.T))


@pytest.mark.parametrize("periodic", [True, False])
@pytest.mark.parametrize(("lattice", "count"), LATTICES)
def test_uniform_deformation(lattice: str, count: int, periodic: bool) -> None:
    body = crystal(lattice, REPEATS[lattice], periodic)
    distance = nearest_distance(body)
    neighbours = find_neighbours(body.x, body, 1.2 * distance)
    d = body.x.shape[1]
    bulk = np.full(len(body.x), True) if periodic else inside(body, 1.2 * distance)
    assert bulk.any()
    assert (neighbours.counts()[bulk] == count).all()
    np.testing.assert_allclose(neighbours.factor[bulk], count / d)
    H = 0.1 * np.random.default_rng(d).normal(size=(d, d))
    now = deformed(body, H)
    strain = virial_strain(neighbours, now.x, now)
    defined = np.isfinite(strain).all(axis=(1, 2))
    assert defined[bulk].all()
    # isotropic remainders of a neighbourhood, at some edges and corners, serve as well
    exact = np.broadcast_to(almansi_of(H), strain[defined].shape)
    np.testing.assert_allclose(strain[defined], exact, atol=1e-12)
    if not periodic:
        height = body.x[:, -1]
        face = np.isclose(height, height.max()) & inside(body, 1.2 * distance, d - 1)
        assert face.any()
        assert not defined[face].any()


def test_bcc_nearest_eight() -> None:
    body = crystal("bcc", (5, 5, 5), True)
    neighbours = find_neighbours(body.x, body, 1.1 * nearest_distance(body))
    assert (neighbours.counts() == 8).all()
    np.testing.assert_allclose(neighbours.factor, 8.0 / 3.0)


def test_hexagonal_factor_is_the_papers() -> None:
    """Three for the six neighbours of the triangular lattice (Zimmermann 1999)."""
    body = crystal("hex", (6, 4), True)
    np.testing.assert_allclose(find_neighbours(body.x, body, 1.2).factor, 3.0)


def test_rotation_gives_no_strain() -> None:
    body = crystal("fcc", (4, 4, 4), True)
    c, s = np.cos(0.7), np.sin(0.7)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    now = deformed(body, R - np.eye(3))
    found = virial_strain(find_neighbours(body.x, body, 0.85), now.x, now)
    np.testing.assert_allclose(found, 0.0, atol=1e-13)


def test_atoms_in_other_images_find_their_neighbours() -> None:
    """Unwrapped positions may lie any number of boxes away."""
    body = crystal("hex", (6, 4), True)
    images = np.random.default_rng(1).integers(-3, 4, size=body.x.shape)
    far = Configuration(body.box, body.x + images @ body.box.edges.T)
    H = np.array([[0.02, 0.01], [-0.03, 0.04]])
    now = deformed(far, H)
    strain = virial_strain(find_neighbours(far.x, far, 1.2), now.x, now)
    np.testing.assert_allclose(strain, np.broadcast_to(almansi_of(H), strain.shape), atol=1e-12)


@pytest.mark.parametrize("lattice", ["hex", "fcc"])
def test_a_box_of_one_cell_is_its_own_neighbour(lattice: str) -> None:
    body = crystal(lattice, (1,) * len(REPEATS[lattice]), True)
    distance = nearest_distance(body)
    assert distance == pytest.approx({"hex": 1.0, "fcc": 0.5**0.5}[lattice])
    counts = find_neighbours(body.x, body, 1.2 * distance).counts()
    assert (counts == {"hex": 6, "fcc": 12}[lattice]).all()


def test_any_share_of_the_atoms_gives_the_same() -> None:
    body = crystal("fcc", (3, 3, 3), True)
    whole = virial_strain(find_neighbours(body.x, body, 0.85), body.x, body)
    some = slice(5, 40)
    part = virial_strain(find_neighbours(body.x[some], body, 0.85), body.x[some], body)
    np.testing.assert_array_equal(part, whole[some])


def test_single_atoms_have_no_distance() -> None:
    body = crystal("hex", (3, 3), False)
    with pytest.raises(InputError, match="too few atoms"):
        nearest_distance(Configuration(body.box, body.x[:1]))
    with pytest.raises(InputError, match="overlapping"):
        nearest_distance(Configuration(body.box, np.repeat(body.x[:1], 5, axis=0)))

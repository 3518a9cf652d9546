"""Displacement gradients over the grid, against fields whose gradient is known."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

from gimpmd_schemas.errors import InputError
from gimpmd_strain.background import GridOptions, increment_gradient, total_gradient
from gimpmd_strain.box import Box, Configuration
from tests.services.md.gimpmd_strain.crystals import crystal, deformed, inside

ONE = MPI.COMM_SELF
BODIES = {
    "hex free": crystal("hex", (16, 9), False),
    "hex periodic": crystal("hex", (16, 9), True),
    "fcc free": crystal("fcc", (6, 6, 7), False),
    "bcc periodic": crystal("bcc", (6, 5, 7), True),
}


def gradient_for(body: Configuration, size: float = 0.05) -> np.ndarray:
    d = body.x.shape[1]
    return size * np.random.default_rng(d).normal(size=(d, d))


def masses(body: Configuration) -> np.ndarray:
    return np.random.default_rng(3).uniform(0.5, 2.0, len(body.x))


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("cell", [1.3, 2.5])
@pytest.mark.parametrize("weights", ["linear", "quadratic"])
def test_linear_fields_are_exact_everywhere(name: str, cell: float, weights: str) -> None:
    """Also at corners, for unequal masses, and for boxes that strain with the body."""
    body = BODIES[name]
    H = gradient_for(body)
    options = GridOptions(cell, 1.0, weights)
    found = total_gradient(body, deformed(body, H), masses(body), options, ONE)
    np.testing.assert_allclose(found, np.broadcast_to(H, found.shape), atol=1e-13)


@pytest.mark.parametrize("name", BODIES)
def test_an_increment_is_the_gradient_at_the_midpoint(name: str) -> None:
    """Of ``x = F X`` it is ``(F - 1) (1 + (F - 1) / 2)^-1``, and its inverse back."""
    body = BODIES[name]
    H = gradient_for(body)
    one, after = np.eye(len(H)), deformed(body, H)
    exact = H @ np.linalg.inv(one + 0.5 * H)
    options = GridOptions(2.0, 1.0)
    found = increment_gradient(body, after, masses(body), options, ONE)
    np.testing.assert_allclose(found, np.broadcast_to(exact, found.shape), atol=1e-13)
    back = increment_gradient(after, body, masses(body), options, ONE)
    np.testing.assert_allclose(back, -found, atol=1e-13)


def test_papers_weights_see_half_of_the_normal_strain_at_a_free_surface() -> None:
    """The reason for the correction; how much they see depends on where the nodes lie."""
    body = BODIES["hex free"]
    H = np.array([[0.0, 0.0], [0.0, 0.01]])
    options = GridOptions(2.5, 1.0, "gimp")
    found = total_gradient(body, deformed(body, H), np.ones(len(body.x)), options, ONE)[:, 1, 1]
    top = np.isclose(body.x[:, 1], body.x[:, 1].max())
    assert found[inside(body, 4.0)] == pytest.approx(0.01, rel=0.05)
    assert found[top].mean() < 0.6 * 0.01


@pytest.mark.parametrize("weights", ["linear", "gimp"])
def test_tilted_periodic_boxes(weights: str) -> None:
    """A periodic crystal in a tilted box is uniform: the box's strain is every atom's."""
    straight = crystal("hex", (16, 9), True)
    body = deformed(straight, np.array([[0.0, 0.4], [0.0, 0.0]]))
    H = gradient_for(body)
    found = total_gradient(
        body, deformed(body, H), np.ones(len(body.x)), GridOptions(2.0, 1.0, weights), ONE
    )
    np.testing.assert_allclose(found, np.broadcast_to(H, found.shape), atol=1e-13)


@pytest.mark.parametrize(("spacing", "order"), [(0.8, 1.0), (2.0, 2.0)])
@pytest.mark.parametrize("lattice", ["hex", "fcc"])
def test_a_plane_wave(lattice: str, spacing: float, order: float) -> None:
    """``u = A sin(k x)`` in a periodic crystal, against ``A k cos(k x)``.

    Summing and taking back damp the wave by ``g^2`` with ``g = sinc^2(k h / 2) sinc(k l)``. Atoms
    narrower than a cell see the slope of the hat functions, constant within it: first order in
    ``k h`` from atom to atom. Atoms as wide as a cell see quadratic B-splines: second order.
    """
    repeats = {"hex": (96, 4), "fcc": (96, 4, 4)}[lattice]
    body = crystal(lattice, repeats, True)
    length = body.box.edges[0, 0]
    errors = []
    for waves in (4, 2, 1):
        k = 2.0 * np.pi * waves / length
        u = np.zeros_like(body.x)
        u[:, 1] = 1e-3 * np.sin(k * body.x[:, 0])
        now = Configuration(body.box, body.x + u)
        options = GridOptions(2.0, spacing)
        found = total_gradient(body, now, np.ones(len(u)), options, ONE)[:, 1, 0] / (1e-3 * k)
        exact = np.cos(k * body.x[:, 0])
        amplitude = found @ exact / (exact @ exact)
        damped = (np.sinc(k / np.pi) ** 2 * np.sinc(0.5 * k * spacing / np.pi)) ** 2
        assert amplitude == pytest.approx(damped, abs=0.15 * (1.0 - damped))
        errors.append(np.sqrt(np.mean((found - exact) ** 2)))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(rates, order, atol=0.15, err_msg=str(errors))


@pytest.mark.parametrize("lattice", ["hex", "fcc"])
@pytest.mark.parametrize("cell", [1.5, 2.0, 3.0])
def test_quadratic_fields_at_a_free_surface(lattice: str, cell: float) -> None:
    """``u = z^2 / 2`` from the surface down, along x and along z: one-sided weights see it deeper.

    Linear ones by up to three quarters of a cell; the others find most of that again.
    """
    body = crystal(lattice, {"hex": (12, 12), "fcc": (7, 7, 12)}[lattice], False)
    depth = body.x[:, -1].max() - body.x[:, -1]
    u = np.zeros_like(body.x)
    u[:, 0] = u[:, -1] = 0.5 * depth**2
    error = {}
    for weights in ("linear", "quadratic"):
        found = total_gradient(
            body,
            Configuration(body.box, body.x + u),
            np.ones(len(u)),
            GridOptions(cell, 0.7, weights),
            ONE,
        )
        rest = np.abs(found[:, [0, -1], -1] + depth[:, None])
        error[weights] = rest[inside(body, 2.0, body.x.shape[1] - 1)].max()
    assert 0.2 * cell < error["linear"] < 0.75 * cell
    assert error["quadratic"] < 0.15 * error["linear"]


@pytest.mark.parametrize("weights", ["linear", "quadratic"])
def test_lone_atoms_and_rows_have_no_strain(weights: str) -> None:
    """Where atoms do not span the plane there is no gradient; the others are not harmed."""
    body = crystal("hex", (8, 4), False)
    row = np.column_stack([np.arange(8.0), np.full(8, 30.0)])
    both = Configuration(body.box, np.vstack([body.x, row, [[50.0, 50.0]]]))
    H = gradient_for(body)
    found = total_gradient(
        both, deformed(both, H), np.ones(len(both.x)), GridOptions(2.0, 1.0, weights), ONE
    )
    assert np.isnan(found[-9:]).all()
    np.testing.assert_allclose(found[:-9], np.broadcast_to(H, (len(body.x), 2, 2)), atol=1e-13)


def test_a_thin_periodic_direction_strains_with_the_box() -> None:
    """One cell of the crystal, thinner than an atom: nothing but the box can strain it."""
    body = crystal("sc", (8, 8, 1), True)
    H = gradient_for(body)
    found = total_gradient(
        body, deformed(body, H), np.ones(len(body.x)), GridOptions(2.0, 1.2), ONE
    )
    np.testing.assert_allclose(found, np.broadcast_to(H, found.shape), atol=1e-13)


def test_free_faces_of_the_box_do_not_matter() -> None:
    """LAMMPS wraps them around the atoms; that is no strain."""
    body = BODIES["hex free"]
    H = gradient_for(body)
    after = deformed(body, H)
    wrapped = Box(after.x.min(axis=0), np.diag(np.ptp(after.x, axis=0)), body.box.periodic)
    now = Configuration(wrapped, after.x)
    found = total_gradient(body, now, masses(body), GridOptions(2.0, 1.0), ONE)
    np.testing.assert_allclose(found, np.broadcast_to(H, found.shape), atol=1e-13)


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ([1e9, 1e9], r"cell = 2.0: the atoms spread over \d+ x \d+ nodes"),
        ([np.nan, 0.0], "not finite"),
    ],
)
def test_atoms_that_flew_away_are_refused(place: list[float], words: str) -> None:
    body = BODIES["hex free"]
    both = Configuration(body.box, np.vstack([body.x, [place]]))
    with pytest.raises(InputError, match=words):
        total_gradient(both, both, np.ones(len(both.x)), GridOptions(2.0, 1.0), ONE)

"""Inner shifts of crystals with a basis, by position, and what forces do on them."""

from __future__ import annotations

import numpy as np

from gimpmd_md.crystal.inner_shift import InnerShift, couples, shifts, tensors
from gimpmd_schemas.mechanics.elasticity import unit_strains


def test_each_strain_gives_its_shift() -> None:
    by_strain = np.random.default_rng(0).normal(size=(2, 6, 3))
    kappa = tensors(by_strain)
    np.testing.assert_array_equal(kappa, kappa.swapaxes(2, 3))
    for m, H in enumerate(unit_strains(3)):
        np.testing.assert_allclose(shifts(kappa, np.stack([H, H])), by_strain[:, m], atol=1e-15)


def test_a_rotation_shifts_nothing() -> None:
    kappa = tensors(np.random.default_rng(1).normal(size=(1, 3, 2)))
    turn = np.array([[[0.0, -0.3], [0.3, 0.0]]])
    np.testing.assert_allclose(shifts(kappa, turn), 0.0, atol=1e-15)


def test_forces_do_the_work_of_the_shifts() -> None:
    rng = np.random.default_rng(2)
    kappa, force = rng.normal(size=(5, 3, 3, 3)), rng.normal(size=(5, 3))
    gradient = rng.normal(size=(5, 3, 3))
    work = (force * shifts(kappa, gradient)).sum()
    np.testing.assert_allclose((couples(kappa, force) * gradient).sum(), work, rtol=1e-12)


def test_atoms_have_the_shift_of_their_place_in_the_cell() -> None:
    vectors, origin = np.array([[1.0, 0.2], [0.0, 1.5]]), np.array([0.3, -0.1])
    basis = np.array([[0.0, 0.0], [0.5, 0.6], [0.1, 1.0]])
    kappa = np.random.default_rng(3).normal(size=(3, 2, 2, 2))
    places = np.array([2, 0, 1, 1, 2])
    numbers = np.array([[0, 0], [3, -2], [1, 5], [-7, 2], [4, 4]])
    x = origin + basis[places] + numbers @ vectors + 1e-9
    found = InnerShift(vectors, origin, basis, kappa).at(x)
    np.testing.assert_array_equal(found, kappa[places])

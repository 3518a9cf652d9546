"""Values on a face as functions of position."""

from __future__ import annotations

import numpy as np

from gimpmd_schemas.case.profiles import KField, Linear, components, value_at
from gimpmd_schemas.mechanics.crack_field import crack_displacement
from gimpmd_schemas.mechanics.elasticity import isotropic

C = isotropic(1.5, 1.0, 2)
X = np.array([[1.0, 2.0], [3.0, -1.0]])


def test_components_are_the_same_everywhere_and_zero_where_free() -> None:
    assert value_at((None, 2.0), X, C).tolist() == [[0.0, 2.0], [0.0, 2.0]]
    assert value_at((), X, C).tolist() == [[0.0, 0.0], [0.0, 0.0]]


def test_a_linear_profile_is_its_value_at_the_centre_and_changes_by_its_gradient() -> None:
    gradient = ((0.0, 0.5), (0.0, 0.0))
    profile = Linear(value=(1.0, None), gradient=gradient, center=(1.0, 2.0))
    assert components(profile) == (1.0, None)
    assert value_at(profile, X, C).tolist() == [[1.0, 0.0], [1.0 - 1.5, 0.0]]


def test_a_linear_profile_without_a_centre_starts_at_the_origin() -> None:
    profile = Linear(value=(0.0, 0.0), gradient=((1.0, 0.0), (0.0, 2.0)))
    np.testing.assert_allclose(value_at(profile, X, C), X * [1.0, 2.0])


def test_a_k_field_takes_the_moduli_of_the_continuum() -> None:
    profile = KField(tip=(1.0, 0.0), k1=0.3, k2=0.1, angle=90.0)
    expected = crack_displacement(X - [1.0, 0.0], 0.3, 0.1, 1.5, 1.0, np.pi / 2)
    np.testing.assert_allclose(value_at(profile, X, C), expected)


def test_a_k_field_does_not_move_a_body_along_z() -> None:
    x = np.array([[2.0, 1.0, 5.0]])
    u = value_at(KField(tip=(0.0, 0.0), k1=1.0), x, isotropic(1.5, 1.0, 3))
    assert u[0, 2] == 0.0
    assert np.abs(u[0, :2]).min() > 0.0

"""A crystal's polynomial energy, within its strain limit and beyond."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.laws import AnisotropicElastic, CauchyBorn, Law
from gimpmd_gimp.laws.law import VOIGT
from gimpmd_schemas.mechanics.hyperelastic import exponents
from tests.services.gimp.laws.sample_laws import (
    DENSITY,
    any_stiffness,
    crystal,
    energy,
    gradients,
    stress,
    stress_at_rest,
)


def green_lagrange(F: np.ndarray) -> np.ndarray:
    """Strain in Voigt order with engineering shear."""
    E, d = 0.5 * (F.transpose(0, 2, 1) @ F - np.eye(F.shape[1])), F.shape[1]
    return np.stack([E[:, i, j] * (1 + (i != j)) for i, j in VOIGT[d]], axis=1)


@pytest.mark.parametrize("d", [2, 3])
def test_energy_of_a_crystal_is_its_polynomial(d: int) -> None:
    """Within the limit, for more points than are evaluated together."""
    law, F = crystal(d), gradients(d, 150, size=0.02)
    E = green_lagrange(F)
    powers = exponents(E.shape[1], 4)
    expected = np.prod(E[:, None] ** powers, axis=2) @ law.coefficients
    np.testing.assert_allclose(energy(law, F), expected, rtol=1e-12)


def stretched(law: Law, E: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Energies at multiples of a strain."""
    F = [np.linalg.cholesky(np.eye(len(E)) + 2.0 * factor * E).T for factor in s]
    return energy(law, np.array(F))


@pytest.mark.parametrize("d", [2, 3])
def test_beyond_the_limit_the_energy_continues_quadratically(d: int) -> None:
    """Value, slope and curvature along a ray are those of the polynomial at the limit."""
    law = crystal(d, degree=5)
    A = np.random.default_rng(8).standard_normal((d, d))
    E = (A + A.T) / np.linalg.norm(A + A.T) * law.strain_limit
    step = 1e-3
    before = stretched(law, E, 1.0 - step * np.arange(5))
    after = stretched(law, E, 1.0 + step * np.arange(5))
    beyond = stretched(law, E, np.array([1.2, 1.4, 1.6, 1.8]))
    size = np.abs(before[0])
    assert np.abs(np.diff(beyond, 3)).max() < 1e-12 * size
    assert np.abs(np.diff(after, 3)).max() < 1e-12 * size
    slopes = np.polyfit(-step * np.arange(5), before, 4)[-3:-1]
    np.testing.assert_allclose(np.polyfit(step * np.arange(5), after, 2)[:2], slopes, rtol=1e-6)


@pytest.mark.parametrize("d", [2, 3])
def test_fastest_wave_of_a_crystal_is_that_of_its_stiffness(d: int) -> None:
    expected = AnisotropicElastic(DENSITY, any_stiffness(d)).wave_speed()
    assert crystal(d).wave_speed() == pytest.approx(expected, rel=1e-12)


def test_a_wrong_number_of_coefficients_is_refused() -> None:
    with pytest.raises(ValueError, match="no polynomial in 3 strains has 7 coefficients"):
        CauchyBorn(1.0, np.ones(7), strain_limit=0.06)


@pytest.mark.parametrize("d", [2, 3])
def test_a_stress_at_rest_adds_its_work(d: int) -> None:
    """``rest : E`` to the energy, ``F rest F^T`` to the stress, within the limit and beyond."""
    rest, F = stress_at_rest(d), gradients(d, 90)
    plain, warm = crystal(d), crystal(d, rest=rest)
    added = energy(warm, F) - energy(plain, F)
    np.testing.assert_allclose(added, green_lagrange(F) @ rest, rtol=1e-9, atol=1e-13)
    S = np.empty((d, d))
    for value, (i, j) in zip(rest, VOIGT[d], strict=True):
        S[i, j] = S[j, i] = value
    np.testing.assert_allclose(
        stress(warm, F) - stress(plain, F), F @ S @ F.transpose(0, 2, 1), atol=1e-13
    )

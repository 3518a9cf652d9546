"""A crystal's energy as a sum over bonds, within their stretch limit and beyond."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.laws import AnisotropicElastic, LatticeSum
from tests.services.gimp.laws.sample_laws import (
    BONDS,
    DENSITY,
    bonded,
    energy,
    gradients,
    stress,
)


def test_energy_of_bonds_is_the_sum_of_their_polynomials() -> None:
    """Within the limit, without the work of the stress at rest, for more points than LANES."""
    law, F = bonded(0.3), gradients(2, 150, size=0.02)
    expected = np.zeros(len(F))
    for R, c in zip(BONDS, law.coefficients, strict=True):
        z = (np.square(F @ R).sum(axis=1)) / (R @ R) - 1.0
        C = np.einsum("nij,nik->njk", F, F) - np.eye(2)
        at_rest = c[0] * np.einsum("j,njk,k->n", R, C, R) / (R @ R)
        expected += (np.polynomial.Polynomial([0.0, *c])(z) - at_rest) / law.area
    np.testing.assert_allclose(energy(law, F), expected, rtol=1e-12, atol=1e-16)


def test_beyond_the_limit_the_energy_of_a_bond_continues_quadratically() -> None:
    """One bond along x in tension and compression: value, slope and curvature are continuous."""
    c = [0.0, 2.0, -3.0, 5.0, 7.0, -1.0]
    law = LatticeSum(DENSITY, 1.0, np.array([[1.0, 0.0]]), [c], stretch_limit=0.1)
    phi = np.polynomial.Polynomial([0.0, *c])
    for end in (0.1, -0.1):
        z = end * np.array([1.0, 1.1, 2.0, 4.0])
        F = np.zeros((4, 2, 2))
        F[:, 0, 0], F[:, 1, 1] = np.sqrt(1.0 + z), 1.0
        ahead = z - end
        slope = phi.deriv()(end) + phi.deriv(2)(end) * ahead
        expected = phi(end) + phi.deriv()(end) * ahead + 0.5 * phi.deriv(2)(end) * ahead**2
        np.testing.assert_allclose(energy(law, F), expected, rtol=1e-12)
        np.testing.assert_allclose(stress(law, F)[:, 0, 0], 2.0 * slope * (1.0 + z), rtol=1e-12)


def test_fastest_wave_of_bonds_is_that_of_their_stiffness() -> None:
    """``C_ijkl = (1 / A) sum_b 4 phi_b''(1) R_i R_j R_k R_l / |R|^4``."""
    law = bonded()
    C = np.zeros((3, 3))
    for R, c in zip(BONDS, law.coefficients, strict=True):
        g = np.array([R[0] ** 2, R[1] ** 2, R[0] * R[1]]) * 2.0 / (R @ R)
        C += 2.0 * c[1] * np.outer(g, g) / law.area
    expected = AnisotropicElastic(DENSITY, C).wave_speed()
    assert law.wave_speed() == pytest.approx(expected, rel=1e-12)

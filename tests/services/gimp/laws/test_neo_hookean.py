"""Neo-Hookean elasticity against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.laws import NeoHookean
from tests.services.gimp.laws.sample_laws import DENSITY, LAME, SHEAR, stress


def test_bar_of_the_one_dimensional_manufactured_solution() -> None:
    """``sigma = E/2 (F - 1/F)``; in one dimension tau is F sigma."""
    F = np.linspace(0.8, 1.2, 5).reshape(-1, 1, 1)
    law = NeoHookean.bar(1.0, 1e4)
    np.testing.assert_allclose(stress(law, F), F * 5e3 * (F - 1 / F), rtol=1e-12, atol=1e-9)
    assert law.wave_speed() == pytest.approx(100.0)


def test_neo_hookean_states() -> None:
    """Simple shear by g at J = 1: tau = mu (b - I). Uniform stretch s: ln J = d ln s."""
    law, g, s = NeoHookean(DENSITY, LAME, SHEAR), 0.4, 1.3
    F = np.array([[[1.0, g], [0.0, 1.0]], [[s, 0.0], [0.0, s]]])
    pressure = LAME * 2 * np.log(s) + SHEAR * (s**2 - 1)
    expected = [SHEAR * np.array([[g**2, g], [g, 0.0]]), pressure * np.eye(2)]
    np.testing.assert_allclose(stress(law, F), expected, atol=1e-14)

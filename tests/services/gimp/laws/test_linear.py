"""Isotropic linear elasticity against Young's modulus and Poisson's ratio."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.laws import LinearElastic
from tests.services.gimp.laws.sample_laws import DENSITY, stress


def test_young_and_poisson() -> None:
    """Strains of a body in uniaxial tension are sigma/E and -nu sigma/E."""
    young, nu, pull = 200.0, 0.3, 0.5
    shear = young / (2 * (1 + nu))
    lame = young * nu / ((1 + nu) * (1 - 2 * nu))
    solid = np.eye(3) + np.diag([1, -nu, -nu]) * pull / young
    tau = stress(LinearElastic(DENSITY, lame, shear), solid[None])[0]
    np.testing.assert_allclose(tau, np.diag([pull, 0, 0]), atol=1e-13)
    plate = LinearElastic.plane_stress(DENSITY, lame, shear)
    np.testing.assert_allclose(stress(plate, solid[None, :2, :2])[0], tau[:2, :2], atol=1e-13)
    assert plate.wave_speed() == pytest.approx((young / (1 - nu**2) / DENSITY) ** 0.5)

"""Displacement around a crack tip against equilibrium, free crack faces and the factors."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_schemas.mechanics.crack_field import crack_displacement

LAME, SHEAR, STEP = 1.5, 1.0, 1e-4


def stress(x: np.ndarray, k1: float, k2: float, angle: float = 0.0) -> np.ndarray:
    """Stress ``(n, 2, 2)`` by central differences."""
    H = np.empty((len(x), 2, 2))
    for j in range(2):
        e = STEP * np.eye(2)[j]
        up = crack_displacement(x + e, k1, k2, LAME, SHEAR, angle)
        down = crack_displacement(x - e, k1, k2, LAME, SHEAR, angle)
        H[:, :, j] = (up - down) / (2.0 * STEP)
    trace = np.trace(H, axis1=1, axis2=2)[:, None, None] * np.eye(2)
    return LAME * trace + SHEAR * (H + H.transpose(0, 2, 1))


@pytest.mark.parametrize(("k1", "k2"), [(1.0, 0.0), (0.0, 1.0)])
def test_stress_ahead_of_the_tip_defines_the_factors(k1: float, k2: float) -> None:
    r = 2.0
    (ahead,) = stress(np.array([[r, 0.0]]), k1, k2)
    scale = np.sqrt(2.0 * np.pi * r)
    assert scale * ahead[1, 1] == pytest.approx(k1, abs=1e-6)
    assert scale * ahead[0, 1] == pytest.approx(k2, abs=1e-6)


@pytest.mark.parametrize(("k1", "k2"), [(1.0, 0.0), (0.0, 1.0)])
def test_crack_faces_are_free_and_the_body_is_in_balance(k1: float, k2: float) -> None:
    faces = stress(np.array([[-2.0, 1e-3], [-2.0, -1e-3]]), k1, k2)
    np.testing.assert_allclose(faces[:, :, 1], 0.0, atol=1e-3)
    x = np.array([[1.3, 0.8], [-0.7, 1.5], [-0.4, -0.9]])
    d = 1e-2
    forces = sum(
        (stress(x + d * e, k1, k2) - stress(x - d * e, k1, k2))[:, :, j] / (2.0 * d)
        for j, e in enumerate(np.eye(2))
    )
    np.testing.assert_allclose(forces, 0.0, atol=1e-4)


def test_the_field_turns_with_the_crack() -> None:
    x = np.array([[1.3, 0.8], [-0.7, 1.5]])
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])  # 90 degrees
    u = crack_displacement(x, 1.0, 0.5, LAME, SHEAR)
    turned = crack_displacement(x @ turn.T, 1.0, 0.5, LAME, SHEAR, np.pi / 2)
    np.testing.assert_allclose(turned, u @ turn.T, atol=1e-12)

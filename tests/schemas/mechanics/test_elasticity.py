"""Moduli of plane waves in any direction."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_schemas.mechanics.elasticity import christoffel, isotropic, plane_wave_moduli

C11, C12, C44 = 170.0, 123.0, 76.0


def cubic() -> np.ndarray:
    C = np.diag([C11] * 3 + [C44] * 3)
    C[:3, :3] += C12 * (1.0 - np.eye(3))
    return C


@pytest.mark.parametrize(
    ("direction", "moduli"),
    [
        ([1, 0, 0], [C11, C44, C44]),
        ([1, 1, 0], [(C11 + C12 + 2 * C44) / 2, C44, (C11 - C12) / 2]),
        ([1, 1, 1], [(C11 + 2 * C12 + 4 * C44) / 3] + [(C11 - C12 + C44) / 3] * 2),
    ],
)
def test_a_cubic_crystal(direction: list[int], moduli: list[float]) -> None:
    """Kittel, Introduction to Solid State Physics, chapter 3."""
    np.testing.assert_allclose(plane_wave_moduli(cubic(), np.array(direction)), moduli, rtol=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_an_isotropic_body_has_the_same_waves_in_all_directions(dim: int) -> None:
    direction = np.array([0.3, -0.5, 0.8][:dim])
    found = plane_wave_moduli(isotropic(2.0, 3.0, dim), direction)
    np.testing.assert_allclose(found, [8.0, *[3.0] * (dim - 1)])


def test_along_an_axis_it_is_the_tensor_of_that_axis() -> None:
    C = cubic() + np.arange(36.0).reshape(6, 6) + np.arange(36.0).reshape(6, 6).T
    for axis in range(3):
        expected = np.linalg.eigvalsh(christoffel(C, axis))[::-1]
        np.testing.assert_allclose(plane_wave_moduli(C, np.eye(3)[axis]), expected)

"""Anisotropic linear elasticity: order of the stiffness, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.laws import AnisotropicElastic
from gimpmd_gimp.laws.law import VOIGT
from tests.services.gimp.laws.sample_laws import any_stiffness, energy, stress


def test_voigt_order_of_the_stiffness() -> None:
    """A unit strain in component w gives column w of the stiffness."""
    for d in (2, 3):
        C = any_stiffness(d)
        for w, (i, j) in enumerate(VOIGT[d]):
            F = np.eye(d)
            F[i, j] += 1.0
            tau = stress(AnisotropicElastic(1.0, C), F[None])[0]
            np.testing.assert_allclose([tau[pair] for pair in VOIGT[d]], C[:, w], rtol=1e-13)
    assert VOIGT[3] == ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


@pytest.mark.parametrize("d", [2, 3])
def test_stress_at_rest(d: int) -> None:
    """The body is at rest at the strain ``-C^-1 rest``, where its energy is least."""
    C = any_stiffness(d)
    rest = np.arange(1.0, len(C) + 1.0)
    law = AnisotropicElastic(1.0, C, rest)
    np.testing.assert_allclose([stress(law, np.eye(d)[None])[0][p] for p in VOIGT[d]], rest)
    strain, F = -np.linalg.solve(C, rest), np.eye(d)
    for value, (i, j) in zip(strain, VOIGT[d], strict=True):
        F[i, j] += value
    np.testing.assert_allclose(stress(law, F[None]), 0.0, atol=1e-13 * np.abs(rest).max())
    assert energy(law, np.eye(d)[None])[0] == 0.0
    assert energy(law, F[None])[0] == pytest.approx(0.5 * rest @ strain)


@pytest.mark.parametrize(
    ("stiffness", "words"),
    [
        (np.eye(4), "3 x 3 or 6 x 6"),
        (np.eye(3) + np.triu(np.ones((3, 3)), 1), "not symmetric"),
        (np.diag([1.0, 1.0, -1.0]), "not positive definite"),
    ],
)
def test_bad_stiffness_is_refused(stiffness: np.ndarray, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        AnisotropicElastic(1.0, stiffness)

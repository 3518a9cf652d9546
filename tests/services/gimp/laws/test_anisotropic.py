"""Anisotropic linear elasticity: order of the stiffness, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.laws import AnisotropicElastic
from gimpmd_gimp.laws.law import VOIGT
from tests.services.gimp.laws.sample_laws import any_stiffness, stress


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

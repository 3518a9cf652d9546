"""Strain tensors of deformations whose strain is known."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_strain.measures import COMPONENTS, MEASURES, components


def test_uniaxial_stretch() -> None:
    H = np.diag([0.1, 0.0])[None]
    assert MEASURES["infinitesimal"](H)[0, 0, 0] == pytest.approx(0.1)
    assert MEASURES["green"](H)[0, 0, 0] == pytest.approx(0.5 * (1.1**2 - 1.0))
    assert MEASURES["almansi"](H)[0, 0, 0] == pytest.approx(0.5 * (1.0 - 1.1**-2))


def test_a_rotation_strains_the_infinitesimal_tensor_alone() -> None:
    c, s = np.cos(0.3), np.sin(0.3)
    H = np.array([[[c - 1.0, -s], [s, c - 1.0]]])
    np.testing.assert_allclose(MEASURES["green"](H), 0.0, atol=1e-15)
    np.testing.assert_allclose(MEASURES["almansi"](H), 0.0, atol=1e-15)
    np.testing.assert_allclose(MEASURES["infinitesimal"](H)[0], (c - 1.0) * np.eye(2), atol=1e-15)


@pytest.mark.parametrize("measure", MEASURES)
def test_small_gradients_agree_and_nan_stays(measure: str) -> None:
    H = 1e-7 * np.random.default_rng(0).normal(size=(4, 3, 3))
    H[2] = np.nan
    found = MEASURES[measure](H)
    np.testing.assert_allclose(found, MEASURES["infinitesimal"](H), atol=1e-12)
    assert np.isnan(found[2]).all()
    assert np.isfinite(found[[0, 1, 3]]).all()


@pytest.mark.parametrize("d", [2, 3])
def test_components_are_named(d: int) -> None:
    tensor = np.arange(float(d * d)).reshape(1, d, d)
    for name, value in zip(COMPONENTS[d], components(tensor)[0], strict=True):
        assert value == tensor[0, "xyz".index(name[0]), "xyz".index(name[1])]

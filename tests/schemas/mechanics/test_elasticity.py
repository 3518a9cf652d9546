"""Stiffness in Voigt notation and moduli of waves, against tensors written out."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_schemas.mechanics.elasticity import (
    VOIGT,
    anisotropic_modulus,
    christoffel,
    christoffel_of,
    isotropic,
    isotropic_modulus,
    keeps_in_plane,
    plane_stress,
    plane_wave_moduli,
    traction,
)

LAME, SHEAR = 1.7, 0.9
COPPER = np.diag([168.4 - 121.4] * 3 + [75.4] * 3)
COPPER[:3, :3] += 121.4
"""C11, C12, C44 in GPa."""


def tensor(stiffness: np.ndarray) -> np.ndarray:
    """``C_ijkl`` of a matrix in Voigt notation."""
    dim = {3: 2, 6: 3}[len(stiffness)]
    C = np.zeros((dim,) * 4)
    for row, (i, j) in enumerate(VOIGT[dim]):
        for column, (k, l) in enumerate(VOIGT[dim]):  # noqa: E741
            for a, b in {(i, j), (j, i)}:
                for c, d in {(k, l), (l, k)}:
                    C[a, b, c, d] = stiffness[row, column]
    return C


def random_stiffness(n: int, seed: int = 0) -> np.ndarray:
    A = np.random.default_rng(seed).normal(size=(n, n))
    return A @ A.T + np.eye(n)


@pytest.mark.parametrize("dim", [2, 3])
def test_every_component_has_its_place_once(dim) -> None:
    pairs = {frozenset(pair) for pair in VOIGT[dim]}
    assert len(pairs) == len(VOIGT[dim]) == dim * (dim + 1) // 2


@pytest.mark.parametrize("dim", [2, 3])
def test_isotropic_stiffness_is_hookes_law(dim) -> None:
    """``C_ijkl = lambda d_ij d_kl + mu (d_ik d_jl + d_il d_jk)``."""
    one = np.eye(dim)
    expected = LAME * np.einsum("ij,kl->ijkl", one, one)
    expected += SHEAR * np.einsum("ik,jl->ijkl", one, one)
    expected += SHEAR * np.einsum("il,jk->ijkl", one, one)
    np.testing.assert_allclose(tensor(isotropic(LAME, SHEAR, dim)), expected, rtol=1e-15)


def test_plane_stress_leaves_no_stress_across_the_sheet() -> None:
    """In-plane stress of the solid whose strain across makes ``sigma_zz = 0``."""
    C = isotropic(LAME, SHEAR, 3)
    across = -C[2, :2] / C[2, 2]
    plane = [0, 1, 5]
    reduced = C[np.ix_(plane, plane)].copy()
    reduced[:2, :2] += np.outer(C[:2, 2], across)
    found = isotropic(plane_stress(LAME, SHEAR), SHEAR, 2)
    np.testing.assert_allclose(found, reduced, rtol=1e-14)


@pytest.mark.parametrize("dim", [2, 3])
def test_isotropic_moduli_are_those_of_the_stiffness(dim) -> None:
    stiffness = isotropic(LAME, SHEAR, dim)
    for kind in ("P", "S", "bar"):
        found = isotropic_modulus(LAME, SHEAR, dim, kind)
        assert found == pytest.approx(anisotropic_modulus(stiffness, kind), rel=1e-12)
    assert isotropic_modulus(LAME, SHEAR, dim, "P") == pytest.approx(LAME + 2.0 * SHEAR)
    assert isotropic_modulus(LAME, SHEAR, dim, "S") == SHEAR


def test_textbook_moduli() -> None:
    """E = 200 and nu = 0.25: lambda = mu = 80. A bar in plane strain has E / (1 - nu^2)."""
    assert isotropic_modulus(80.0, 80.0, 3, "bar") == pytest.approx(200.0)
    assert isotropic_modulus(80.0, 80.0, 2, "bar") == pytest.approx(200.0 / (1.0 - 0.25**2))
    sheet = plane_stress(80.0, 80.0)
    assert isotropic_modulus(sheet, 80.0, 2, "bar") == pytest.approx(200.0)


@pytest.mark.parametrize("n", [3, 6])
def test_christoffel_tensor_is_a_part_of_the_stiffness(n) -> None:
    stiffness = random_stiffness(n)
    C = tensor(stiffness)
    for axis in range(len(C)):
        expected = C[:, axis, :, axis]
        np.testing.assert_allclose(christoffel(stiffness, axis), expected, rtol=1e-15)


@pytest.mark.parametrize("n", [3, 6])
def test_fastest_and_slowest_wave_along_the_axes(n) -> None:
    """``rho c^2`` are the eigenvalues of ``n . C . n``."""
    stiffness = random_stiffness(n, seed=1)
    C = tensor(stiffness)
    modes = np.array([np.linalg.eigvalsh(C[:, axis, :, axis]) for axis in range(len(C))])
    assert anisotropic_modulus(stiffness, "P") == pytest.approx(modes.max(), rel=1e-12)
    assert anisotropic_modulus(stiffness, "S") == pytest.approx(modes.min(), rel=1e-12)
    # uniaxial stress along x: stress over strain
    strain = np.linalg.solve(stiffness, np.eye(n)[0])
    assert anisotropic_modulus(stiffness, "bar") == pytest.approx(1.0 / strain[0], rel=1e-12)


def test_copper() -> None:
    """Young's modulus along [100] is 66.7 GPa (Nye); waves have C11 and C44."""
    assert anisotropic_modulus(COPPER, "P") == pytest.approx(168.4)
    assert anisotropic_modulus(COPPER, "S") == pytest.approx(75.4)
    assert anisotropic_modulus(COPPER, "bar") == pytest.approx(66.7, rel=1e-3)


C11, C12, C44 = 168.4, 121.4, 75.4


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
    np.testing.assert_allclose(plane_wave_moduli(COPPER, np.array(direction)), moduli, rtol=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_an_isotropic_body_has_the_same_waves_in_all_directions(dim: int) -> None:
    direction = np.array([0.3, -0.5, 0.8][:dim])
    found = plane_wave_moduli(isotropic(2.0, 3.0, dim), direction)
    np.testing.assert_allclose(found, [8.0, *[3.0] * (dim - 1)])


def test_along_an_axis_it_is_the_tensor_of_that_axis() -> None:
    C = COPPER + np.arange(36.0).reshape(6, 6) + np.arange(36.0).reshape(6, 6).T
    for axis in range(3):
        expected = np.linalg.eigvalsh(christoffel(C, axis))[::-1]
        np.testing.assert_allclose(plane_wave_moduli(C, np.eye(3)[axis]), expected)


@pytest.mark.parametrize("stiffness", [isotropic(LAME, SHEAR, 2), COPPER], ids=["2-D", "3-D"])
def test_traction_is_the_stress_on_planes_across_an_axis(stiffness: np.ndarray) -> None:
    C = tensor(stiffness)
    dim = C.shape[0]
    gradient = np.random.default_rng(1).normal(size=(4, dim, dim))
    stress = np.einsum("ijkl,nkl->nij", C, gradient)
    for axis in range(dim):
        found = traction(stiffness, axis, gradient)
        np.testing.assert_allclose(found, stress[:, :, axis], rtol=1e-12)


@pytest.mark.parametrize("n", [3, 6])
def test_christoffel_tensors_of_wave_vectors(n) -> None:
    C = random_stiffness(n)
    k = np.random.default_rng(1).normal(size=(5, 2 if n == 3 else 3))
    expected = np.einsum("ijlm,nj,nm->nil", tensor(C), k, k)
    np.testing.assert_allclose(christoffel_of(C, k), expected, atol=1e-12)


def test_planes_that_keep_the_motion_of_waves() -> None:
    """C26, of yy and xy, couples motions along x and y of waves in the plane of y and z alone."""
    skew = COPPER.copy()
    skew[1, 5] = skew[5, 1] = 8.0
    for first, second in ((0, 1), (1, 2), (2, 0)):
        assert keeps_in_plane(COPPER, first, second)
        assert keeps_in_plane(skew, first, second) == ((first, second) != (1, 2))

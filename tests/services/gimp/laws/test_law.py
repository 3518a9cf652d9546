"""All laws: stress against energy, columns of the history, fastest wave of a stiffness."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.laws import AnisotropicElastic, Law, LinearElastic, NeoHookean
from gimpmd_gimp.laws.law import VOIGT, history_fields, history_size, is_inelastic
from tests.services.gimp.laws.sample_laws import (
    DENSITY,
    LAME,
    SHEAR,
    any_stiffness,
    at_rest,
    bonded,
    crystal,
    energy,
    gradients,
    isotropic,
    laws,
    plastic,
    stress,
)

EVERY = [pytest.param(law, d, id=f"{law.name} {d}D") for d in (1, 2, 3) for law in laws(d)]


def slope(law: Law, F: np.ndarray) -> np.ndarray:
    """dW/dF by central differences, whose error is about the square of their step."""
    out, step, d = np.empty_like(F), 1e-5, F.shape[1]
    for i in range(d):
        for j in range(d):
            change = np.zeros((d, d))
            change[i, j] = step
            out[:, i, j] = (energy(law, F + change) - energy(law, F - change)) / (2.0 * step)
    return out


@pytest.mark.parametrize(("law", "d"), EVERY)
def test_stress_is_the_slope_of_the_energy(law: Law, d: int) -> None:
    """``tau = dW/dF F^T``; for small-strain laws ``tau = dW/dF``."""
    F = gradients(d)
    expected = slope(law, F)
    if law.finite:
        expected = expected @ F.transpose(0, 2, 1)
    np.testing.assert_allclose(stress(law, F), expected, atol=1e-8, rtol=1e-8)


@pytest.mark.parametrize(("law", "d"), EVERY)
def test_no_stress_and_no_energy_at_rest(law: Law, d: int) -> None:
    rest = np.eye(d)[None]
    assert np.abs(stress(law, rest)).max() == 0.0
    assert energy(law, rest)[0] == 0.0


@pytest.mark.parametrize(("law", "d"), [p for p in EVERY if p.values[0].finite])
def test_rotation_after_the_strain_changes_no_energy(law: Law, d: int) -> None:
    F = gradients(d)
    Q = np.linalg.qr(np.random.default_rng(3).standard_normal((d, d)))[0]
    Q[0] *= np.linalg.det(Q)
    np.testing.assert_allclose(energy(law, Q @ F), energy(law, F), rtol=1e-13)
    np.testing.assert_allclose(stress(law, Q @ F), Q @ stress(law, F) @ Q.T, atol=1e-13)


@pytest.mark.parametrize(("law", "d"), EVERY)
def test_only_the_points_asked_for_are_written(law: Law, d: int) -> None:
    F, order = gradients(d, 9), np.array([8, 2, 5, 0, 7])
    tau, W = np.full_like(F, 99.0), np.full(9, 99.0)
    history = at_rest(law, F)
    law.stress(order, 1, 4, F, history, tau)
    law.energy(order, 1, 4, F, history, W)
    asked = np.isin(np.arange(9), [2, 5, 0])
    np.testing.assert_array_equal(tau[asked], stress(law, F)[asked])
    np.testing.assert_array_equal(W[asked], energy(law, F)[asked])
    assert (tau[~asked] == 99.0).all()
    assert (W[~asked] == 99.0).all()


@pytest.mark.parametrize("d", [1, 2, 3])
def test_laws_of_one_stiffness_agree_at_small_strain(d: int) -> None:
    """Isotropic, anisotropic, J2 below yield, and neo-Hookean within the square of the strain."""
    F = gradients(d, size=1e-6)
    linear = stress(LinearElastic(DENSITY, LAME, SHEAR), F)
    anisotropic = AnisotropicElastic(DENSITY, isotropic(d))
    np.testing.assert_allclose(stress(anisotropic, F), linear, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(stress(NeoHookean(DENSITY, LAME, SHEAR), F), linear, atol=1e-10)
    speed = ((LAME + 2 * SHEAR) / DENSITY) ** 0.5
    np.testing.assert_allclose(stress(plastic(d), F), linear, rtol=1e-9, atol=1e-15)
    for law in (
        anisotropic,
        LinearElastic(1.0, LAME, SHEAR),
        NeoHookean(1.0, LAME, SHEAR),
        plastic(d),
    ):
        assert law.wave_speed() * law.density**0.5 == pytest.approx(speed * DENSITY**0.5)


@pytest.mark.parametrize(
    ("law", "d"), [(crystal(2), 2), (crystal(3), 3), (bonded(), 2)], ids=["2D", "3D", "bonds"]
)
def test_a_point_of_a_crystal_does_not_depend_on_its_neighbours(law: Law, d: int) -> None:
    """The same bits however points are shared out, within the limit and beyond."""
    F = np.concatenate([gradients(d, 90, 0.02), gradients(d, 90, 0.3)])
    F = F[np.random.default_rng(0).permutation(len(F))]
    tau, W = np.empty_like(F), np.empty(len(F))
    history = at_rest(law, F)
    for p in range(len(F)):
        law.stress(np.arange(len(F)), p, p + 1, F, history, tau)
        law.energy(np.arange(len(F)), p, p + 1, F, history, W)
    np.testing.assert_array_equal(tau, stress(law, F))
    np.testing.assert_array_equal(W, energy(law, F))


def test_fastest_wave_in_copper() -> None:
    """Along [111], where rho c^2 = (C11 + 2 C12 + 4 C44) / 3, not along the axes."""
    c11, c12, c44, rho = 168.4e9, 121.4e9, 75.4e9, 8932.0
    C = isotropic(3, c12, c44)
    C[range(3), range(3)] = c11
    speed = AnisotropicElastic(rho, C).wave_speed()
    assert speed == pytest.approx(((c11 + 2 * c12 + 4 * c44) / 3 / rho) ** 0.5, rel=1e-12)


@pytest.mark.parametrize("d", [2, 3])
def test_fastest_wave_of_a_crystal_without_symmetry(d: int) -> None:
    """Against the largest acoustic eigenvalue over a fine set of directions."""
    C = any_stiffness(d)
    n = np.random.default_rng(1).standard_normal((200000 if d == 3 else 2000, d))
    n /= np.linalg.norm(n, axis=1)[:, None]
    N = np.zeros((len(n), len(VOIGT[d]), d))  # strain of the wave with polarization a is N a
    for w, (i, j) in enumerate(VOIGT[d]):
        N[:, w, i] += n[:, j]
        N[:, w, j] += n[:, i] * (i != j)
    best = np.linalg.eigvalsh(np.einsum("nvi,vw,nwj->nij", N, C, N)).max()
    found = DENSITY * AnisotropicElastic(DENSITY, C).wave_speed() ** 2
    assert found == pytest.approx(best, rel=1e-4)
    assert found >= best * (1 - 1e-12)


def test_history_variables_by_name() -> None:
    """Columns in the order of the law's list; variables of one component are flat."""
    law = plastic(2)
    assert is_inelastic(law)
    assert history_size(law) == 5
    history = np.arange(10.0).reshape(2, 5)
    fields = history_fields(law, history)
    assert list(fields) == ["plastic_strain", "equivalent_plastic_strain"]
    np.testing.assert_array_equal(fields["plastic_strain"], history[:, :4])
    np.testing.assert_array_equal(fields["equivalent_plastic_strain"], [4.0, 9.0])


def test_elastic_laws_have_no_history() -> None:
    law = LinearElastic(DENSITY, LAME, SHEAR)
    assert not is_inelastic(law)
    assert history_size(law) == 0
    assert history_fields(law, np.zeros((3, 0))) == {}


@pytest.mark.parametrize(("law", "d"), EVERY)
def test_strains_that_every_law_must_follow_and_strains_that_none_does(law: Law, d: int) -> None:
    """A crystal of atoms breaks at 0.1; laws are used at strains of some percent."""
    assert 0.02 <= law.trusted_strain <= 0.5

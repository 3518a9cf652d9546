"""Constitutive laws against exact values, and each stress against its own energy."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.laws import (
    AnisotropicElastic,
    CauchyBorn,
    LatticeSum,
    Law,
    LinearElastic,
    NeoHookean,
    make_law,
)
from gimpmd_gimp.laws.law import VOIGT
from gimpmd_schemas.mechanics.hyperelastic import exponents

LAME, SHEAR, DENSITY = 2.3, 1.7, 0.9


def isotropic(d: int, lame: float = LAME, shear: float = SHEAR) -> np.ndarray:
    """Stiffness in Voigt's notation."""
    C = np.diag([2.0 * shear] * d + [shear] * (len(VOIGT[d]) - d))
    C[:d, :d] += lame
    return C


def any_stiffness(d: int) -> np.ndarray:
    """A stiffness without symmetry, positive definite."""
    n = len(VOIGT[d])
    A = np.random.default_rng(d).standard_normal((n, n))
    return A @ A.T + n * np.eye(n)


def crystal(d: int, degree: int = 4) -> CauchyBorn:
    """A crystal without symmetry; about half of the strains of `gradients` are beyond its reach."""
    C, powers = any_stiffness(d), exponents(len(VOIGT[d]), degree)
    coefficients = np.random.default_rng(4).uniform(-1, 1, len(powers))
    for n, power in enumerate(powers[powers.sum(axis=1) == 2]):
        v, w = np.repeat(np.arange(len(C)), power)
        coefficients[n] = C[v, w] if v != w else 0.5 * C[v, v]
    return CauchyBorn(DENSITY, coefficients, strain_limit=0.12, dimension=d)


BONDS = np.array([[1.0, 0.1], [0.4, 1.1], [-0.7, 0.9], [1.6, 1.3]])


def bonded(reach: float = 0.12) -> LatticeSum:
    """A crystal under stress at rest, of bonds without symmetry and unlike each other.

    About half of the strains of `gradients` are beyond the reach of one of them.
    """
    energy = [[0.3, 4.0, -9.0], [-0.2, 3.0, 1.0, 8.0, -20.0], [0.1, 2.5], [-0.05, 0.4, -1.0, 2.0]]
    return LatticeSum(DENSITY, 1.3, BONDS, energy, reach)


def laws(d: int) -> list[Law]:
    return [
        LinearElastic(DENSITY, LAME, SHEAR),
        NeoHookean(DENSITY, LAME, SHEAR),
        AnisotropicElastic(DENSITY, any_stiffness(d)),
        *([crystal(d)] if d > 1 else []),
        *([bonded()] if d == 2 else []),
    ]


EVERY = [pytest.param(law, d, id=f"{law.name} {d}D") for d in (1, 2, 3) for law in laws(d)]


def gradients(d: int, n: int = 20, size: float = 0.1) -> np.ndarray:
    return np.eye(d) + size * np.random.default_rng(7).uniform(-1, 1, (n, d, d))


def stress(law: Law, F: np.ndarray) -> np.ndarray:
    out = np.full_like(F, np.nan)
    law.stress(np.arange(len(F)), 0, len(F), F, out)
    return out


def energy(law: Law, F: np.ndarray) -> np.ndarray:
    out = np.full(len(F), np.nan)
    law.energy(np.arange(len(F)), 0, len(F), F, out)
    return out


def slope(law: Law, F: np.ndarray) -> np.ndarray:
    """dW/dF by central differences, which err by about the square of their step."""
    out, step, d = np.empty_like(F), 1e-5, F.shape[1]
    for i in range(d):
        for j in range(d):
            change = np.zeros((d, d))
            change[i, j] = step
            out[:, i, j] = (energy(law, F + change) - energy(law, F - change)) / (2.0 * step)
    return out


@pytest.mark.parametrize(("law", "d"), EVERY)
def test_stress_is_the_slope_of_the_energy(law: Law, d: int) -> None:
    """``tau = dW/dF F^T``; at small strain F is the unit tensor there."""
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
    law.stress(order, 1, 4, F, tau)
    law.energy(order, 1, 4, F, W)
    asked = np.isin(np.arange(9), [2, 5, 0])
    np.testing.assert_array_equal(tau[asked], stress(law, F)[asked])
    np.testing.assert_array_equal(W[asked], energy(law, F)[asked])
    assert (tau[~asked] == 99.0).all()
    assert (W[~asked] == 99.0).all()


def test_young_and_poisson() -> None:
    """Strains of a body under tension alone are sigma/E and -nu sigma/E."""
    young, nu, pull = 200.0, 0.3, 0.5
    shear = young / (2 * (1 + nu))
    lame = young * nu / ((1 + nu) * (1 - 2 * nu))
    solid = np.eye(3) + np.diag([1, -nu, -nu]) * pull / young
    tau = stress(LinearElastic(DENSITY, lame, shear), solid[None])[0]
    np.testing.assert_allclose(tau, np.diag([pull, 0, 0]), atol=1e-13)
    plate = LinearElastic.plane_stress(DENSITY, lame, shear)
    np.testing.assert_allclose(stress(plate, solid[None, :2, :2])[0], tau[:2, :2], atol=1e-13)
    assert plate.wave_speed() == pytest.approx((young / (1 - nu**2) / DENSITY) ** 0.5)
    bar = LinearElastic.uniaxial(DENSITY, lame, shear)
    np.testing.assert_allclose(stress(bar, solid[None, :1, :1])[0, 0, 0], pull, rtol=1e-12)
    assert bar.wave_speed() == pytest.approx((young / DENSITY) ** 0.5)


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


@pytest.mark.parametrize("d", [1, 2, 3])
def test_laws_of_one_stiffness_agree_at_small_strain(d: int) -> None:
    """Isotropic, anisotropic and neo-Hookean; the last within the square of the strain."""
    F = gradients(d, size=1e-6)
    linear = stress(LinearElastic(DENSITY, LAME, SHEAR), F)
    anisotropic = AnisotropicElastic(DENSITY, isotropic(d))
    np.testing.assert_allclose(stress(anisotropic, F), linear, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(stress(NeoHookean(DENSITY, LAME, SHEAR), F), linear, atol=1e-10)
    speed = ((LAME + 2 * SHEAR) / DENSITY) ** 0.5
    for law in (anisotropic, LinearElastic(1.0, LAME, SHEAR), NeoHookean(1.0, LAME, SHEAR)):
        assert law.wave_speed() * law.density**0.5 == pytest.approx(speed * DENSITY**0.5)


def test_voigt_order_of_the_stiffness() -> None:
    """Unit strain in component w gives column w of the stiffness: xx, yy, zz, yz, xz, xy."""
    for d in (2, 3):
        C = any_stiffness(d)
        for w, (i, j) in enumerate(VOIGT[d]):
            F = np.eye(d)
            F[i, j] += 1.0
            tau = stress(AnisotropicElastic(1.0, C), F[None])[0]
            np.testing.assert_allclose([tau[pair] for pair in VOIGT[d]], C[:, w], rtol=1e-13)
    assert VOIGT[3] == ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


def test_fastest_wave_in_copper() -> None:
    """Along [111], where rho c^2 = (C11 + 2 C12 + 4 C44) / 3, not along the axes."""
    c11, c12, c44, rho = 168.4e9, 121.4e9, 75.4e9, 8932.0
    C = isotropic(3, c12, c44)
    C[range(3), range(3)] = c11
    speed = AnisotropicElastic(rho, C).wave_speed()
    assert speed == pytest.approx(((c11 + 2 * c12 + 4 * c44) / 3 / rho) ** 0.5, rel=1e-12)


def green_lagrange(F: np.ndarray) -> np.ndarray:
    """Strain in Voigt's notation, with engineering shear."""
    E, d = 0.5 * (F.transpose(0, 2, 1) @ F - np.eye(F.shape[1])), F.shape[1]
    return np.stack([E[:, i, j] * (1 + (i != j)) for i, j in VOIGT[d]], axis=1)


@pytest.mark.parametrize("d", [2, 3])
def test_energy_of_a_crystal_is_its_polynomial(d: int) -> None:
    """Within the reach, for more points than are worked on side by side."""
    law, F = crystal(d), gradients(d, 150, size=0.02)
    E = green_lagrange(F)
    powers = exponents(E.shape[1], 4)
    expected = np.prod(E[:, None] ** powers, axis=2) @ law.coefficients
    np.testing.assert_allclose(energy(law, F), expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("law", "d"), [(crystal(2), 2), (crystal(3), 3), (bonded(), 2)], ids=["2D", "3D", "bonds"]
)
def test_a_point_of_a_crystal_does_not_feel_those_beside_it(law: Law, d: int) -> None:
    """The same bits whoever shares the work, within the reach and beyond."""
    F = np.concatenate([gradients(d, 90, 0.02), gradients(d, 90, 0.3)])
    F = F[np.random.default_rng(0).permutation(len(F))]
    tau, W = np.empty_like(F), np.empty(len(F))
    for p in range(len(F)):
        law.stress(np.arange(len(F)), p, p + 1, F, tau)
        law.energy(np.arange(len(F)), p, p + 1, F, W)
    np.testing.assert_array_equal(tau, stress(law, F))
    np.testing.assert_array_equal(W, energy(law, F))


def stretched(law: Law, E: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Energies along the ray of a strain."""
    F = [np.linalg.cholesky(np.eye(len(E)) + 2.0 * factor * E).T for factor in s]
    return energy(law, np.array(F))


@pytest.mark.parametrize("d", [2, 3])
def test_beyond_the_reach_a_crystal_goes_on_quadratically(d: int) -> None:
    """Value, slope and curvature along a ray are those of the polynomial at the reach."""
    law = crystal(d, degree=5)
    A = np.random.default_rng(8).standard_normal((d, d))
    E = (A + A.T) / np.linalg.norm(A + A.T) * law.strain_limit
    step = 1e-3
    before = stretched(law, E, 1.0 - step * np.arange(5))
    after = stretched(law, E, 1.0 + step * np.arange(5))
    beyond = stretched(law, E, np.array([1.2, 1.4, 1.6, 1.8]))
    size = np.abs(before[0])
    assert np.abs(np.diff(beyond, 3)).max() < 1e-12 * size
    assert np.abs(np.diff(after, 3)).max() < 1e-12 * size
    slopes = np.polyfit(-step * np.arange(5), before, 4)[-3:-1]
    np.testing.assert_allclose(np.polyfit(step * np.arange(5), after, 2)[:2], slopes, rtol=1e-6)


@pytest.mark.parametrize("d", [2, 3])
def test_fastest_wave_of_a_crystal_is_that_of_its_stiffness(d: int) -> None:
    expected = AnisotropicElastic(DENSITY, any_stiffness(d)).wave_speed()
    assert crystal(d).wave_speed() == pytest.approx(expected, rel=1e-12)


def test_energy_of_bonds_is_the_sum_of_their_polynomials() -> None:
    """Within the reach, less what stress at rest does, for more points than share the work."""
    law, F = bonded(0.3), gradients(2, 150, size=0.02)
    expected = np.zeros(len(F))
    for R, c in zip(BONDS, law.coefficients, strict=True):
        z = (np.square(F @ R).sum(axis=1)) / (R @ R) - 1.0
        C = np.einsum("nij,nik->njk", F, F) - np.eye(2)
        at_rest = c[0] * np.einsum("j,njk,k->n", R, C, R) / (R @ R)
        expected += (np.polynomial.Polynomial([0.0, *c])(z) - at_rest) / law.area
    np.testing.assert_allclose(energy(law, F), expected, rtol=1e-12, atol=1e-16)


def test_beyond_the_reach_a_bond_goes_on_quadratically() -> None:
    """A single bond along x, pulled and pressed: value, slope and curvature are continuous."""
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


def test_a_wrong_number_of_coefficients_is_refused() -> None:
    with pytest.raises(ValueError, match="no polynomial in 3 strains has 7 coefficients"):
        CauchyBorn(1.0, np.ones(7), strain_limit=0.06)


@pytest.mark.parametrize("d", [2, 3])
def test_fastest_wave_of_a_crystal_without_symmetry(d: int) -> None:
    """Against the largest acoustic eigenvalue over a fine net of directions."""
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


def test_law_of_a_case_in_metal_units(build) -> None:
    """1 bar is 6.2415e-7 eV / A^3, and 1 eV is 9648.53 g/mol A^2 / ps^2."""
    material = {"from": "moduli", "density": 3.0, "lame": 2e5, "shear": 1e5}
    law = make_law(build(units="metal", continuum={"material": material}))
    assert isinstance(law, LinearElastic)
    assert law.density == 3.0
    assert law.lame == pytest.approx(2e5 * 6.2415091e-7 * 9648.533, rel=1e-6)
    assert law.lame == pytest.approx(2 * law.shear)


def test_laws_of_the_materials_of_a_case(build) -> None:
    """One of every kind; in metal units a bar is 6.022e-3 g/mol / (A ps^2)."""
    bar = 6.2415091e-7 * 9648.533

    def law(**material: object) -> Law:
        return make_law(build(units="metal", continuum={"material": {"density": 3.0} | material}))

    moduli = {"from": "moduli", "lame": 2e5, "shear": 1e5}
    neo = law(**moduli, model="neo-hookean")
    assert isinstance(neo, NeoHookean)
    assert neo.shear == pytest.approx(1e5 * bar, rel=1e-6)
    plate = law(**moduli, plane="stress")
    assert isinstance(plate, LinearElastic)
    assert plate.lame == pytest.approx(1e5 * bar, rel=1e-6)  # 2 lame mu / (lame + 2 mu)
    C = any_stiffness(2)
    stiff = law(**{"from": "stiffness"}, stiffness=C.tolist())
    assert isinstance(stiff, AnisotropicElastic)
    np.testing.assert_allclose(stiff.stiffness, C * bar, rtol=1e-6)
    energy = {"coefficients": [1.0, 0.0, 0.0, 1.0, 0.0, 0.5], "strain_limit": 0.05}
    cauchy_born = law(**moduli | {"from": "hyperelastic"}, **energy)
    assert isinstance(cauchy_born, CauchyBorn)
    assert (cauchy_born.strain_limit, cauchy_born.dimension) == (0.05, 2)
    np.testing.assert_allclose(
        cauchy_born.coefficients, bar * np.array([1, 0, 0, 1, 0, 0.5]), rtol=1e-6
    )
    bonds = {"area": 2.0, "bonds": [[1.0, 0.0], [0.0, 1.0]], "energy": [[0.0, 1.0]] * 2}
    sums = law(**moduli | {"from": "lattice"}, **bonds, stretch_limit=0.1)
    assert isinstance(sums, LatticeSum)
    # C11 = 2 phi'' / A = 8 eV / (2 A^2), in g/mol / ps^2
    F = np.array([[[1.0 + 1e-7, 0.0], [0.0, 1.0]]])
    assert stress(sums, F)[0, 0, 0] == pytest.approx(4.0 * 9648.533 * 1e-7, rel=1e-6)
    assert {made.density for made in (neo, plate, stiff, cauchy_born, sums)} == {3.0}

"""Thermal stress of crystals: exact sums, and the law that contains it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from gimpmd_gimp.laws import LatticeSum, make_law, thermal_forces, thermal_stress
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.errors import BackendError
from tests.services.gimp.laws.sample_laws import energy, stress

SIDE = 1.1
AREA = SIDE**2 * 3**0.5 / 2
VECTORS = SIDE * np.array([[1.0, 0.0], [0.5, 3**0.5 / 2]])

NEAREST = np.array([VECTORS[0], VECTORS[1], VECTORS[1] - VECTORS[0]])
NEXT = np.array([VECTORS.sum(axis=0), 2 * VECTORS[1] - VECTORS[0], VECTORS[1] - 2 * VECTORS[0]])
"""Half of the six nearest neighbours of the hexagonal lattice, and of the six behind them."""


def turned(vectors: np.ndarray, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return vectors @ np.array([[c, s], [-s, c]])


def expanded(power: float, scale: float) -> list[float]:
    """``scale s^-power`` about s = 1, without its constant."""
    c = np.cumprod([-(power + k) / (k + 1) for k in range(3)])
    return (scale * c).tolist()


@pytest.mark.parametrize("angle", [0.0, 0.3])
def test_soft_spheres_scale(angle: float) -> None:
    """With ``phi = r^-2p`` all stiffnesses go as ``s^-(p+1)``: ``S = -(p + 1) heat / A``.

    Whatever the number of neighbours; a hexagonal crystal bears the same along all axes.
    """
    p, heat = 6.0, 0.01
    bonds = turned(np.concatenate([NEAREST, NEXT]), angle)
    energy = [expanded(p, scale) for scale in (1.0,) * 3 + (3.0**-p,) * 3]
    S = thermal_stress(bonds, energy, AREA, heat)
    exact = -(p + 1.0) * heat / AREA
    # isotropic but for the grid of wave vectors, which is not hexagonal
    np.testing.assert_allclose(S, [exact, exact, 0.0], atol=1e-5 * abs(exact))


def test_springs_of_no_length_feel_no_strain() -> None:
    """Energies linear in s have stiffnesses that never change."""
    S = thermal_stress(NEAREST, [[1.0]] * 3, AREA, 1.0)
    np.testing.assert_allclose(S, 0.0, atol=1e-12)


def test_three_equal_bonds() -> None:
    """``phi = c1 z + c3 z^3``: ``D = J(k) I`` and each bond has a third of it.

    So ``<tr D^-1 dD/dE> = 4 c3 / c1 sum_b ds_b/dE = 12 c3 / c1`` for either axis.
    """
    c1, c3, heat = 2.0, -5.0, 0.1
    S = thermal_stress(NEAREST, [[c1, 0.0, c3]] * 3, AREA, heat)
    exact = 6.0 * heat * c3 / (AREA * c1)
    np.testing.assert_allclose(S, [exact, exact, 0.0], atol=1e-5 * abs(exact))


def test_forces_of_three_equal_bonds_share_the_stress() -> None:
    """By symmetry they lie along the bonds: ``sum_b t R_b R_b^T / (|R| A) = 3 t |R| / (2 A) I``."""
    energy = [[2.0, 0.3, -5.0]] * 3
    t, S = (f(NEAREST, energy, AREA, 0.1) for f in (thermal_forces, thermal_stress))
    exact = 2.0 * AREA * S[:2].mean() / (3.0 * SIDE) * NEAREST / SIDE
    # symmetric but for the grid of wave vectors, which is not hexagonal
    np.testing.assert_allclose(t, exact, atol=1e-4 * np.abs(exact).max())


def test_a_crystal_without_symmetry_against_differences() -> None:
    """Of ``heat / 2 <ln det D>`` of a periodic crystal of N x N cells, by strains and bonds.

    The mean of a finite crystal lacks the wave vectors near zero, an error as N^-2 that is
    extrapolated.
    """
    vectors = np.array([[1.0, 0.1], [0.4, 1.1]])
    bonds = np.array([vectors[0], vectors[1], vectors[1] - vectors[0], vectors.sum(axis=0)])
    energy = [[0.3, 4.0, -9.0], [0.2, 3.0, 1.0, 8.0], [0.1, 2.5], [0.05, 0.4, -1.0, 2.0]]
    area = abs(np.linalg.det(vectors))

    def free_energy(now: np.ndarray, n: int) -> float:
        numbers = (np.stack(np.meshgrid(np.arange(n), np.arange(n)), -1) + 0.5).reshape(-1, 2) / n
        D = np.zeros((n * n, 2, 2))
        for r, R, c in zip(now, bonds, energy, strict=True):
            phase = np.cos(2.0 * np.pi * numbers @ np.rint(R @ np.linalg.inv(vectors)))
            D += 2.0 * (1.0 - phase)[:, None, None] * hessian(r, R @ R, c)
        return float(0.5 * np.log(np.linalg.det(D)).mean())

    def hessian(r: np.ndarray, square: float, c: Sequence[float]) -> np.ndarray:
        phi = np.polynomial.Polynomial([0.0, *c])
        z = r @ r / square - 1.0
        first, second = phi.deriv()(z), phi.deriv(2)(z)
        return 2.0 * first / square * np.eye(2) + 4.0 * second / square**2 * np.outer(r, r)

    def slopes(n: int) -> np.ndarray:
        step, found = 1e-5, []
        for xx, yy, xy in np.eye(3):
            E = step * np.array([[xx, 0.5 * xy], [0.5 * xy, yy]])
            up, down = (np.linalg.cholesky(np.eye(2) + sign * 2.0 * E).T for sign in (1.0, -1.0))
            found.append((free_energy(bonds @ up.T, n) - free_energy(bonds @ down.T, n)) / area)
        for move in step * np.eye(bonds.size).reshape(-1, *bonds.shape):
            found.append(free_energy(bonds + move, n) - free_energy(bonds - move, n))
        return np.array(found) / (2.0 * step)

    expected = (4.0 * slopes(48) - slopes(24)) / 3.0
    t, S = (f(bonds, energy, area, 1.0) for f in (thermal_forces, thermal_stress))
    for found, right in ((S, expected[:3]), (t.ravel(), expected[3:])):
        np.testing.assert_allclose(found, right, atol=1e-4 * np.abs(right).max())


@pytest.mark.parametrize(
    ("bonds", "energy", "words"),
    [
        (NEAREST, [expanded(6.0, -1.0)] * 3, "unstable at rest"),
        (NEAREST[:1], [[0.0, 1.0]], "no two of its bonds span"),
        (NEXT, [[0.0, 1.0]] * 3, "no two of its bonds span"),
    ],
    ids=["pulled apart", "a chain", "a coarser lattice"],
)
def test_no_vibrations(bonds: np.ndarray, energy: list[list[float]], words: str) -> None:
    with pytest.raises(BackendError, match=f"continuum.temperature: .*{words}"):
        thermal_stress(bonds, energy, AREA, 0.1)


CRYSTAL = [[0.3, 4.0, -9.0], [-0.2, 3.0, 1.0], [0.1, 2.5]]


def law(thermal: np.ndarray | None) -> LatticeSum:
    return LatticeSum(1.0, AREA, NEAREST, CRYSTAL, 0.12, thermal)


def gradients() -> np.ndarray:
    return np.eye(2) + 0.05 * np.random.default_rng(5).uniform(-1, 1, (20, 2, 2))


def test_law_bears_the_thermal_stress_beside_the_crystals_own() -> None:
    thermal = np.array([-0.4, -0.3, 0.05])
    own = sum(
        2.0 * c[0] * np.outer(R, R) / (R @ R) / AREA for R, c in zip(NEAREST, CRYSTAL, strict=True)
    )
    expected = own + thermal[[[0, 2], [2, 1]]]
    np.testing.assert_allclose(stress(law(thermal), np.eye(2)[None])[0], expected, atol=1e-14)
    np.testing.assert_allclose(stress(law(None), np.eye(2)[None])[0], 0.0, atol=1e-14)
    assert energy(law(thermal), np.eye(2)[None])[0] == 0.0


def test_thermal_stress_does_work_on_the_strain() -> None:
    """``W`` and ``tau`` differ by ``S : E`` and ``F S F^T``, at finite strains too."""
    thermal, F = np.array([-0.4, -0.3, 0.05]), gradients()
    S = thermal[[[0, 2], [2, 1]]]
    E = 0.5 * (F.transpose(0, 2, 1) @ F - np.eye(2))
    warm, cold = law(thermal), law(np.zeros(3))
    np.testing.assert_allclose(
        energy(warm, F) - energy(cold, F), np.einsum("ij,nij->n", S, E), atol=1e-14
    )
    np.testing.assert_allclose(
        stress(warm, F) - stress(cold, F), F @ S @ F.transpose(0, 2, 1), atol=1e-13
    )


def test_temperature_of_a_case(build) -> None:
    """In metal units: 300 K are 0.0258520 eV, and 1 eV is 9648.53 g/mol A^2 / ps^2."""
    material = {
        "from": "lattice",
        "density": 3.0,
        "lame": 2e5,
        "shear": 2e5,
        "area": AREA,
        "bonds": NEAREST.tolist(),
        "energy": [[2.0, 0.0, -5.0]] * 3,
        "stretch_limit": 0.1,
    }
    made = make_law(
        make_plan(build(units="metal", continuum={"material": material, "temperature": 300.0}))
    )
    own = 2.0 * 2.0 * 1.5 * 9648.533 / AREA
    exact = own - 6.0 * 0.025852 * 9648.533 * 2.5 / AREA
    np.testing.assert_allclose(stress(made, np.eye(2)[None])[0, 0, 0], exact, rtol=1e-5)
    still = make_law(make_plan(build(units="metal", continuum={"material": material})))
    np.testing.assert_allclose(stress(still, np.eye(2)[None]), 0.0, atol=1e-9)

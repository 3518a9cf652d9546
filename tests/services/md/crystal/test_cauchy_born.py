"""The energy that LAMMPS tabulates and its fit, against lattice sums."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from scipy.optimize import minimize

from gimpmd_md.crystal import moduli
from gimpmd_md.crystal.cauchy_born import (
    Table,
    energy_in_space,
    fit,
    largest_error,
    least_curvature,
    shells,
    strain_energy,
    strains_in_space,
    stress_error,
    tabulate,
    terms,
)
from gimpmd_md.crystal.cell import Cell, open_cell
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.mechanics.hyperelastic import exponents, quadratic, stiffness
from gimpmd_schemas.mechanics.units import UNITS
from tests.copper_sites import write_scripts
from tests.physics import lattice


def exact(E: np.ndarray, turn: float = 0.0) -> Table:
    """Table of the Lennard-Jones crystal by lattice sums."""
    return Table(E, *lattice.strains(E, turn))


@pytest.fixture
def cell(folder: Path):
    with open_cell("cell.in", "lj", MPI.COMM_SELF, folder / "log.lammps") as cell:
        yield cell


def test_lammps_tabulates_the_lattice_sums(cell: Cell) -> None:
    table = tabulate(cell, shells([0.003, 0.05], seed=5))
    W, S = lattice.strains(table.E)
    assert cell.tolerance is None
    np.testing.assert_allclose(table.W, W, rtol=1e-9, atol=1e-13)
    np.testing.assert_allclose(table.S, S, atol=1e-11)


def test_the_fit_is_the_crystal(cell: Cell) -> None:
    """Stress within 0.2 % at strains of 1 % and 1 % at 4 %, in all directions."""
    coefficients, limit = strain_energy(cell)
    assert limit == 0.06
    for norm, most in ((0.001, 2e-3), (0.01, 2e-3), (0.04, 1e-2), (0.06, 2e-2)):
        assert stress_error(coefficients, exact(shells([norm], seed=9))) < most


def test_symmetry_takes_its_terms(cell: Cell) -> None:
    """Odd powers of the shear vanish, for the rows lie along x: 47 of 80 terms are left."""
    coefficients = strain_energy(cell).coefficients
    odd = exponents(3, 6)[:, 2] % 2 == 1
    assert (coefficients[odd] == 0.0).all()
    assert (coefficients[~odd] != 0.0).all()
    assert np.count_nonzero(coefficients) == 47


def test_a_crystal_askew_has_all_its_terms() -> None:
    """Rows at 10 degrees to x: no mirror line along the axes, but the same fit."""
    turn = np.radians(10.0)
    coefficients = fit(exact(shells(np.linspace(0.006, 0.06, 10), seed=1), turn), 6)
    assert np.count_nonzero(coefficients) > 70
    assert stress_error(coefficients, exact(shells([0.01], seed=2), turn)) < 2e-3


def test_a_polynomial_is_found_again() -> None:
    powers = exponents(3, 4)
    wanted = np.random.default_rng(0).uniform(0.5, 1.0, len(powers)) * 20.0 ** powers.sum(axis=1)
    E = shells([0.01, 0.02, 0.04, 0.06], seed=1)
    value, slope = terms(E, powers)
    np.testing.assert_allclose(fit(Table(E, value @ wanted, slope @ wanted), 4), wanted, rtol=1e-9)


def test_curvature_along_rays() -> None:
    """Of ``W = E : E - 5 E11^3`` at norm r it is least along E11: ``(2 - 30 r) / 2``."""
    powers = exponents(3, 3)
    coefficients = np.zeros(len(powers))
    for power, c in {(2, 0, 0): 1.0, (0, 2, 0): 1.0, (0, 0, 2): 0.5, (3, 0, 0): -5.0}.items():
        coefficients[(powers == power).all(axis=1)] = c
    found = least_curvature(coefficients, 0.05)
    assert found == pytest.approx(1.0 - 15.0 * 0.05, abs=0.05)
    assert found >= 1.0 - 15.0 * 0.05


def test_other_units(folder: Path) -> None:
    """The same crystal as argon in metal units: coefficients are pressures."""
    sigma, epsilon = 3.4, 0.0104
    text = (folder / "cell.in").read_text()
    for name, value in {
        "scale": sigma,
        "style": "metal",
        "mass": 39.95,
        "epsilon": epsilon,
    }.items():
        text = f"variable {name} index {value}\n" + text
    (folder / "cell.in").write_text(text)
    E = shells([0.01], seed=4)
    with open_cell("cell.in", "metal", MPI.COMM_SELF, folder / "log.lammps") as cell:
        table = tabulate(cell, E)
    pressure = epsilon / sigma**2 * UNITS["metal"].nktv2p
    W, S = lattice.strains(E)
    np.testing.assert_allclose(table.W, W * pressure, rtol=1e-5)
    np.testing.assert_allclose(table.S, S * pressure, atol=1e-6 * pressure)


FIRST, SECOND = (1.0, 100.0), (3.0**0.5, 20.0)
"""Rest length and stiffness of the springs k (r - r0)^2 of a honeycomb."""


def honeycomb_energy(F: np.ndarray) -> float:
    """Energy per area with the shift between the two sublattices at its best."""
    a = 3.0**0.5
    first = np.array([[0.0, 1.0], [-a / 2, -0.5], [a / 2, -0.5]])
    second = np.array([[a, 0.0], [a / 2, 1.5], [-a / 2, 1.5]])

    def springs(bonds: np.ndarray, length: float, stiffness: float) -> float:
        return float(stiffness * ((np.linalg.norm(bonds, axis=1) - length) ** 2).sum())

    def energy(shift: np.ndarray) -> float:
        return springs(first @ F.T + shift, *FIRST) + 2.0 * springs(second @ F.T, *SECOND)

    area = 3.0 * a / 2.0
    return float(minimize(energy, np.zeros(2), tol=1e-14).fun) / area


def test_atoms_of_a_lattice_with_a_basis_relax(folder: Path) -> None:
    springs = "step(1.4-r)*100*(r-1)^2 + step(r-1.4)*20*(r-1.7320508075688772)^2"
    (folder / "honeycomb.in").write_text(
        "units lj\ndimension 2\nboundary p p p\natom_style atomic\n"
        "lattice custom 0.76980035891950105 a1 1.7320508075688772 0 0 a2 0 3 0 a3 0 0 1 "
        "basis 0 0 0 basis 0 0.33333333333333333 0 "
        "basis 0.5 0.5 0 basis 0.5 0.83333333333333333 0\n"
        "region cell block 0 1.7320508075688772 0 3 -0.5 0.5 units box\n"
        "create_box 1 cell\ncreate_atoms 1 region cell\nreplicate 5 3 1\n"
        f"mass 1 1\npair_style lepton 1.9\npair_coeff 1 1 '{springs}'\n"
    )
    E = shells([0.02], seed=6)[::10]
    with open_cell("honeycomb.in", "lj", MPI.COMM_SELF, folder / "log.lammps") as cell:
        assert cell.engine.lammps.get_natoms() == 60
        assert cell.tolerance is not None
        table = tabulate(cell, E)
    for strain, W in zip(E, table.W, strict=True):
        xx, yy, xy = strain
        F = np.linalg.cholesky([[1 + 2 * xx, xy], [xy, 1 + 2 * yy]]).T
        assert honeycomb_energy(F) == pytest.approx(W, rel=1e-6)


def test_an_energy_with_a_jump_is_refused(folder: Path) -> None:
    """A cutoff just beyond the second neighbours, who leave at a strain of 0.2 %."""
    text = (folder / "cell.in").read_text().replace("2.5*${scale}", "1.93*${scale}")
    (folder / "cell.in").write_text(text.replace("1.1132013035564605", "1.1163"))
    with (
        open_cell("cell.in", "lj", MPI.COMM_SELF, folder / "log.lammps") as cell,
        pytest.raises(BackendError, match=r"cell.in: no polynomial .* use model: linear"),
    ):
        strain_energy(cell)


# --- in space ----------------------------------------------------------------------------


@pytest.fixture
def copper(tmp_path: Path):
    write_scripts(tmp_path)
    script = str(tmp_path / "cell.in")
    with open_cell(script, "metal", MPI.COMM_SELF, tmp_path / "log.lammps", dims=(3,)) as cell:
        yield cell


def any_energy(degree: int) -> np.ndarray:
    """Coefficients of a polynomial without symmetry in space."""
    powers = exponents(6, degree)
    numbers = np.random.default_rng(0).uniform(0.5, 1.0, len(powers))
    return np.asarray(numbers * 20.0 ** powers.sum(axis=1))


def table_of(coefficients: np.ndarray, degree: int, E: np.ndarray) -> Table:
    value, slope = terms(E, exponents(6, degree))
    return Table(E, value @ coefficients, slope @ coefficients)


def test_a_polynomial_in_space_is_found_again_with_its_stiffness() -> None:
    wanted = any_energy(4)
    table = table_of(wanted, 4, strains_in_space(0.03, 4))
    found = fit(table, 4, stiffness(6, wanted))
    np.testing.assert_array_equal(found[:21], wanted[:21])
    np.testing.assert_allclose(found, wanted, rtol=1e-8)


def test_a_given_stiffness_stays_as_it_is() -> None:
    """Whatever the table says."""
    wanted, C = any_energy(3), np.diag(np.arange(1.0, 7.0))
    found = fit(table_of(wanted, 3, strains_in_space(0.03, 3)), 3, C)
    np.testing.assert_array_equal(stiffness(6, found), C)


def test_energy_of_copper(copper: Cell) -> None:
    """Cubic, axes along those of the cell: 29 of 77 terms, those equal by symmetry are equal."""
    C = np.array(moduli.measure_all(copper).stiffness)
    found, limit = energy_in_space(copper, C, 3)
    assert limit == 0.03
    np.testing.assert_array_equal(stiffness(6, found), C)
    assert np.count_nonzero(found) == 29
    powers, cubes = exponents(6, 3), found[21:]
    axes = [cubes[(powers[21:] == 3 * np.eye(6, dtype=int)[k]).all(axis=1)][0] for k in range(3)]
    np.testing.assert_allclose(axes, axes[0], rtol=1e-6)
    check = tabulate(copper, shells([0.01], seed=9, count=3, dim=3))
    assert largest_error(found, check) < 0.02
    assert largest_error(quadratic(C), check) > 0.02


def test_a_crystal_that_softens_before_the_limit_is_refused(copper: Cell) -> None:
    C = np.array(moduli.measure_all(copper).stiffness)
    with pytest.raises(BackendError, match=r"cell.in: no polynomial of degree 3 .* lower strain_l"):
        energy_in_space(copper, C, 3, strain_limit=0.1)

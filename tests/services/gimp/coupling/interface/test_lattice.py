"""Sums over the bonds of a crystal, its sites and periods, and how far a law is from it."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.coupling.interface.lattice import make_lattice, mismatch
from gimpmd_gimp.laws import J2Plasticity, LatticeSum, LinearElastic, thermal_stress
from gimpmd_schemas.case.form import Crystal
from gimpmd_schemas.errors import BackendError
from tests.physics.lattice import AREA, NEIGHBOURS, SPACING, deform
from tests.services.gimp.coupling.interface.crystal_bodies import (
    ORIGIN,
    ROWS,
    half_star,
    lj_crystal,
    sites,
)

A, PAIR = SPACING, 2.0 * ROWS


def test_the_lattice_has_the_sums_of_the_potential():
    lattice = make_lattice(lj_crystal(ORIGIN))
    assert lattice.area == pytest.approx(AREA)
    F = np.array([[1.01, 0.02], [-0.005, 0.99]])
    P = lattice.stress(lattice.forces(F))
    np.testing.assert_allclose(P @ F.T, deform(F[None])[1][0], atol=1e-9)
    step = 1e-5
    for m in range(2):
        H = np.zeros((2, 2))
        H[m, 1] = step
        change = lattice.forces(np.eye(2) + H) - lattice.forces(np.eye(2) - H)
        expected = np.einsum("mij,mj->mi", lattice.stiffnesses(), lattice.bonds @ H.T)
        np.testing.assert_allclose(change, 2.0 * expected, atol=1e-8 * np.abs(expected).max())


def test_sites_fill_a_box_whatever_the_vectors():
    low, high = np.array([-3.0, 2.0]), np.array([11.0, 7.5])
    expected = sorted(map(tuple, sites(low, high).round(9)))
    for vectors in (
        ((A, 0.0), (0.5 * A, ROWS)),
        ((0.5 * A, -ROWS), (-A, 0.0)),
        ((3.5 * A, ROWS), (A, 0.0)),
    ):
        crystal = lj_crystal(ORIGIN)
        lattice = make_lattice(
            Crystal(vectors, crystal.origin, crystal.bonds, crystal.energy, crystal.stretch_limit)
        )
        found = sorted(map(tuple, lattice.sites(low, high).round(9)))
        np.testing.assert_allclose(found, expected, atol=2e-9)
        assert lattice.period(0) == pytest.approx(A)
        assert lattice.period(1) == pytest.approx(PAIR)


def test_a_crystal_without_rows_along_the_plane_is_refused():
    c, s = np.cos(0.1), np.sin(0.1)
    turned = NEIGHBOURS[:2] @ np.array([[c, s], [-s, c]])
    crystal = lj_crystal(ORIGIN)
    vectors = (tuple(turned[0].tolist()), (0.3, 1.1))
    lattice = make_lattice(
        Crystal(vectors, crystal.origin, crystal.bonds, crystal.energy, crystal.stretch_limit)
    )
    with pytest.raises(BackendError, match=r"coupling.crystal.vectors.*scheme: velocity"):
        lattice.period(0)


def test_a_warm_crystal_is_its_law():
    """Stress and moduli; without the heat there is none at rest."""
    crystal, heat = lj_crystal(ORIGIN), 0.05
    bonds = np.array(crystal.bonds)
    S = thermal_stress(bonds, crystal.energy, AREA, heat)
    law = LatticeSum(1.0, AREA, bonds, crystal.energy, crystal.stretch_limit, S)
    warm, cold = make_lattice(crystal, heat=heat), make_lattice(crystal)
    # what bonds bear across themselves adds up to nothing, but for the means over wave vectors
    assert max(mismatch(warm, law)) < 1e-6
    rest = warm.stress(warm.forces(np.eye(2)))
    np.testing.assert_allclose(rest, [[S[0], S[2]], [S[2], S[1]]], atol=1e-6 * abs(S[0]))
    assert np.abs(cold.stress(cold.forces(np.eye(2)))).max() < 1e-3 * abs(S[0])


def test_mismatch_of_a_law():
    lattice, mu = make_lattice(lj_crystal(ORIGIN)), 27.8332
    moduli, stress = mismatch(lattice, LinearElastic(1.0, mu, mu))
    assert moduli < 1e-5
    # tension, the worst of all: along x or y, by sums written down anew
    e = 0.01 * np.array([np.diag([1.0, 0.0]), np.diag([0.0, 1.0])])
    _, tau = deform(np.eye(2) + e)
    hooke = mu * 0.01 * np.eye(2) + 2.0 * mu * e
    assert stress == pytest.approx(max(np.abs(hooke - tau).max((1, 2)) / tau.max((1, 2))), rel=1e-6)
    assert mismatch(lattice, LinearElastic(1.0, 1.2 * mu, mu))[0] == pytest.approx(
        0.2 / 3.0, rel=1e-3
    )
    moduli, stress = mismatch(lattice, J2Plasticity(1.0, mu, mu, 1e-3 * mu, 0.0, 2))
    assert moduli < 1e-5
    assert stress > 0.5  # it yields at a tenth of the strain


def test_energies_are_in_mechanical_units() -> None:
    plain, scaled = (make_lattice(lj_crystal(ORIGIN), factor) for factor in (1.0, 2.5))
    assert plain.energy.shape == (len(half_star()), 18)
    np.testing.assert_allclose(scaled.energy, 2.5 * plain.energy, rtol=1e-15)
    assert plain.reach == pytest.approx(2.0 * SPACING)


def test_short_series_are_filled_with_zeros() -> None:
    """A bond of one coefficient is a spring under force without stiffness of its own."""
    crystal = Crystal(((1.0, 0.0), (0.0, 1.0)), (0.0, 0.0), ((1.0, 0.0),), ((0.3,),), 0.1)
    lattice = make_lattice(crystal)
    assert lattice.energy.tolist() == [[0.3, 0.0]]
    F = np.array([[1.1, 0.0], [0.2, 1.0]])
    np.testing.assert_allclose(lattice.forces(F), [[0.6 * 1.1, 0.6 * 0.2]], rtol=1e-14)
    np.testing.assert_allclose(lattice.stiffnesses()[0], 0.6 * np.eye(2), rtol=1e-14)

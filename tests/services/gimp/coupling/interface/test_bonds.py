"""Bonds across the planes, their weights, and the lattice they belong to."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.coupling.interface.bonds import crossing_weights, find_bonds, ghost_weights
from gimpmd_gimp.coupling.interface.lattice import make_lattice, mismatch
from gimpmd_gimp.laws import J2Plasticity, LatticeSum, LinearElastic, thermal_stress
from gimpmd_schemas.case.form import Crystal
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.planes import Interface
from tests.physics.lattice import AREA, CUTOFF, NEIGHBOURS, SPACING, deform
from tests.services.gimp.coupling.interface.crystal_bodies import (
    INF,
    ROWS,
    half_star,
    lj_crystal,
    make_body,
)

A, PAIR = SPACING, 2.0 * ROWS
ORIGIN = (0.25 * A, 0.5 * ROWS)


def sites(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Sites in a box, found one row at a time."""
    found = [
        (ORIGIN[0] + (i + 0.5 * (j % 2)) * A, ORIGIN[1] + j * ROWS)
        for j in range(-40, 80)
        for i in range(-40, 80)
    ]
    x = np.array(found)
    return x[((x >= low) & (x <= high)).all(axis=1)]


@pytest.mark.parametrize("periodic", [(False, False), (False, True)])
@pytest.mark.parametrize("planes", [((9 * A, 16 * A), (-INF, INF)), ((-INF, 16 * A), (-INF, INF))])
def test_bonds_are_all_pairs_of_a_free_atom_and_a_ghost(planes, periodic):
    grid = BackgroundGrid((0.0, 0.0), PAIR, (15, 8), periodic)
    interface = Interface(planes, ((max(planes[0][0] - 2.6, 0.0), 22.0), (0.0, 8 * PAIR)))
    bonds = find_bonds(make_lattice(lj_crystal(ORIGIN)), interface, grid)
    low, high = np.zeros(2), np.array([15.0, 8.0]) * PAIR
    free = sites(low, high)
    beyond = np.array([0.0, 3.0]) * periodic[1]
    others = sites(low - beyond, high + beyond)
    free, others = free[interface.free(free)], others[~interface.free(others)]
    pairs = np.linalg.norm(free[:, None] - others, axis=2) < CUTOFF
    expected = sorted((*free[i].round(6), *others[j].round(6)) for i, j in np.argwhere(pairs))
    found = sorted(map(tuple, np.hstack([bonds.free, bonds.ghost]).round(6)))
    np.testing.assert_allclose(found, expected, atol=2e-6)
    vectors = bonds.sign[:, None] * half_star()[bonds.kind]
    np.testing.assert_allclose(bonds.ghost - bonds.free, vectors, atol=1e-9)


def test_crossings_lie_on_the_box_and_part_the_bonds():
    body = make_body(4.0, (15, 15), ((16 * A, 36 * A), (9 * PAIR, 19 * PAIR)))
    bonds, planes = body.bonds, np.array(body.interface.planes)
    on = np.abs(bonds.crossing[:, :, None] - planes).min(axis=2)
    assert (on[np.arange(bonds.count), 1 - bonds.axis] == 0.0).all()
    assert (bonds.crossing >= planes[:, 0] - 1e-12).all()
    assert (bonds.crossing <= planes[:, 1] + 1e-12).all()
    split = bonds.ghost + bonds.theta[:, None] * (bonds.free - bonds.ghost)
    np.testing.assert_allclose(split, bonds.crossing, atol=1e-12)
    assert (bonds.theta > 0.1).all()
    assert (bonds.theta < 0.9).all()


def test_weights_move_crossings_and_ghosts_by_linear_fields_exactly():
    body = make_body(3.3, (18, 18), ((-INF, 30 * A), (9 * PAIR, INF)))
    x = body.grid.positions()
    np.testing.assert_allclose(
        ghost_weights(body.bonds, body.grid) @ x, body.bonds.ghost, atol=1e-12
    )
    weights = crossing_weights(body.bonds, body.lattice, body.grid)
    np.testing.assert_allclose(weights @ x, body.bonds.crossing, atol=1e-12)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-14)
    assert weights.data.min() > 0.0


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


def test_planes_too_near_the_end_of_the_atoms_are_refused():
    grid = BackgroundGrid((0.0, 0.0), 4.0, (10, 10), (False, False))
    interface = Interface(((8 * A, INF), (-INF, INF)), ((8 * A - 1.5, 40.0), (0.0, 40.0)))
    with pytest.raises(BackendError, match=r"x = 8\.9.*md.region.*scheme: velocity"):
        find_bonds(make_lattice(lj_crystal(ORIGIN)), interface, grid)


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

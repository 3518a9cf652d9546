"""Bonds across the planes, and their weights."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_gimp.coupling.interface.bonds import crossing_weights, find_bonds, ghost_weights
from gimpmd_gimp.coupling.interface.lattice import make_lattice
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.planes import Interface
from tests.physics.lattice import CUTOFF, SPACING
from tests.services.gimp.coupling.interface.crystal_bodies import (
    INF,
    ORIGIN,
    ROWS,
    half_star,
    lj_crystal,
    make_body,
    sites,
)

A, PAIR = SPACING, 2.0 * ROWS


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


def test_planes_too_near_the_end_of_the_atoms_are_refused():
    grid = BackgroundGrid((0.0, 0.0), 4.0, (10, 10), (False, False))
    interface = Interface(((8 * A, INF), (-INF, INF)), ((8 * A - 1.5, 40.0), (0.0, 40.0)))
    with pytest.raises(BackendError, match=r"x = 8\.9.*md.region.*scheme: velocity"):
        find_bonds(make_lattice(lj_crystal(ORIGIN)), interface, grid)

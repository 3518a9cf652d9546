"""Nodal forces that uniform strain leaves at the planes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from gimpmd_gimp.coupling.sites.pieces import cut_cells
from gimpmd_gimp.coupling.sites.residual import residual
from gimpmd_gimp.coupling.sites.shells import Shells, inside
from gimpmd_md.crystal.site_off.measure import forces
from gimpmd_md.engines.lammps.site_off.commands import Potential
from gimpmd_md.engines.lammps.site_off.double import with_off_sites
from gimpmd_schemas.grid.background import BackgroundGrid
from tests.services.gimp.coupling.sites.crystals import Bodies, Crystal, copper, lennard_jones
from tests.services.gimp.coupling.sites.interfaces import Setup


def test_the_continuum_pulls_with_its_stress_on_plane_2() -> None:
    """``sum_i F_i (x) x_i`` is the stress times the volume within plane 2."""
    grid = BackgroundGrid((0.0, 0.0, 0.0), 1.0, (6, 7, 6), (False,) * 3)
    active = ((2.2, 3.7), (1.9, 4.4), (2.5, 3.1))
    pieces = cut_cells(grid, Shells((((2.5, 3.0), (2.5, 3.0), (2.7, 3.0)),), (active,)))
    P = np.random.default_rng(0).normal(size=(3, 3))
    found = residual(grid, pieces, np.zeros((grid.size, 3)), P)
    moment = found.T @ grid.positions()
    np.testing.assert_allclose(moment, P * np.prod(np.ptp(active, axis=1)), atol=1e-12)
    np.testing.assert_allclose(found.sum(axis=0), 0.0, atol=1e-12)


def test_at_a_face_of_the_body_its_load_is_left_out() -> None:
    """What is left is the stress on plane 2, whose ends lie on the face."""
    grid = BackgroundGrid((0.0, 0.0), 1.0, (6, 7), (False, False))
    shells = Shells((((-np.inf, 3.0), (2.5, 3.0)),), (((-np.inf, 3.7), (1.9, 4.4)),))
    P = np.random.default_rng(0).normal(size=(2, 2))
    found = residual(grid, cut_cells(grid, shells), np.zeros((grid.size, 2)), P)
    np.testing.assert_allclose(found.sum(axis=0), 2.5 * P[:, 0], atol=1e-12)
    moment = found.T @ grid.positions()
    x_side = np.outer(2.5 * P[:, 0], [3.7, 0.5 * (1.9 + 4.4)])
    top, bottom = (np.outer(s * 3.7 * P[:, 1], [0.5 * 3.7, y]) for s, y in ((1, 4.4), (-1, 1.9)))
    np.testing.assert_allclose(moment, x_side + top + bottom, atol=1e-12)


def test_ghosts_and_continuum_balance_as_a_whole() -> None:
    """What the crystal within plane 2 pulls inward, the continuum beyond it pulls outward."""
    lj = lennard_jones()
    a, row = lj.layers
    free = ((-9 * a, 7 * a), (-5 * row, 4 * row))
    active = ((-13 * a, 11 * a), (-7 * row, 6 * row))
    setup = Setup(lj, 3.0, Shells((free,), (active,)))
    F = np.array([[1.01, 0.004], [0.002, 0.99]])
    found = setup.residual(F)
    size = np.abs(found).max()
    assert size > 1e-3
    np.testing.assert_allclose(found.sum(axis=0), 0.0, atol=1e-11)
    np.testing.assert_allclose(setup.bodies.force(F)[: setup.free], 0.0, atol=1e-12)


def body(crystal: Crystal, size: float) -> Bodies:
    """A block, the middle of which is active."""
    box = ((-size, size),) * crystal.dim
    within = ((-0.5 * size, 0.4 * size),) * crystal.dim
    x = crystal.sites(box)
    return Bodies(crystal, x, inside((within,), x))


@pytest.mark.parametrize(
    ("crystal", "size", "style", "coeff"),
    [
        (lennard_jones(), 9.0, "lj/cut 2.5", "1 1 1 1"),
        (copper(), 12.0, "eam/alloy", "* * Cu_mishin1.eam.alloy Cu"),
    ],
)
def test_lammps_finds_the_same_forces(
    crystal: Crystal, size: float, style: str, coeff: str, tmp_path: Path
) -> None:
    """So it can measure the residual of any potential whose sites can be switched off."""
    bodies = body(crystal, size)
    F = np.eye(crystal.dim) + 0.01 * np.random.default_rng(7).normal(size=(crystal.dim,) * 2)
    own = Potential(tuple(style.split()), (tuple(coeff.split()),))
    potential, units = with_off_sites(own, 1, tmp_path), "metal" if crystal.dim == 3 else "lj"
    kinds = np.ones(len(bodies.x), dtype=int)
    (expected,) = forces(
        potential,
        units,
        bodies.x,
        kinds,
        1,
        ~bodies.active,
        [bodies.x @ F.T],
        MPI.COMM_SELF,
        tmp_path,
    )
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(bodies.force(F), expected, atol=1e-10)

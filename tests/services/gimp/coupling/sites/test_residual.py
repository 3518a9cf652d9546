"""Nodal forces that uniform strain leaves at the planes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from scipy import sparse

from gimpmd_gimp.coupling.sites.pieces import cut_cells
from gimpmd_gimp.coupling.sites.residual import residual
from gimpmd_gimp.coupling.sites.shells import Shells, inside
from gimpmd_md.crystal.site_off.commands import Potential
from gimpmd_md.crystal.site_off.double import with_off_sites
from gimpmd_md.engines.lammps.library import Engine
from gimpmd_schemas.grid.background import BackgroundGrid
from tests.services.gimp.coupling.sites.crystals import Bodies, Crystal, copper, lennard_jones
from tests.services.gimp.coupling.sites.interfaces import Setup


def test_the_continuum_pulls_with_its_stress_on_plane_2() -> None:
    """``sum_i F_i (x) x_i`` is the stress times the volume within plane 2."""
    grid = BackgroundGrid((0.0, 0.0, 0.0), 1.0, (6, 7, 6), (False,) * 3)
    active = ((2.2, 3.7), (1.9, 4.4), (2.5, 3.1))
    pieces = cut_cells(grid, Shells((((2.5, 3.0), (2.5, 3.0), (2.7, 3.0)),), (active,)))
    P = np.random.default_rng(0).normal(size=(3, 3))
    none = sparse.csr_array((0, grid.size))
    found = residual(grid, pieces, none, np.empty((0, 3)), P)
    moment = found.T @ grid.positions()
    np.testing.assert_allclose(moment, P * np.prod(np.ptp(active, axis=1)), atol=1e-12)
    np.testing.assert_allclose(found.sum(axis=0), 0.0, atol=1e-12)


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


def in_lammps(bodies: Bodies, potential: Potential, F: np.ndarray, folder: Path) -> np.ndarray:
    """Forces by LAMMPS, with a potential whose sites can be switched off."""
    d = bodies.crystal.dim
    x = np.zeros((len(bodies.x), 3))
    x[:, :d] = bodies.x @ F.T
    engine = Engine(MPI.COMM_SELF, folder / "log.lammps")
    try:
        engine.commands(
            [
                "units metal" if d == 3 else "units lj",
                f"dimension {d}",
                "boundary s s s" if d == 3 else "boundary s s p",
                "region box block -30 30 -30 30 " + ("-30 30" if d == 3 else "-0.5 0.5"),
                "create_box 2 box",
            ]
        )
        types = np.where(bodies.active, 1, 2).tolist()
        ids = list(range(1, len(x) + 1))
        engine.lammps.create_atoms(len(x), ids, types, x.ravel().tolist())
        doubled = with_off_sites(potential, 1, folder)
        engine.commands([*doubled.commands(), "mass * 1.0", "run 0 post no"])
        return engine.vectors("f")[np.argsort(engine.atoms("id"))].copy()
    finally:
        engine.close()


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
    potential = Potential(tuple(style.split()), (tuple(coeff.split()),))
    expected = in_lammps(bodies, potential, F, tmp_path)
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(bodies.force(F), expected, atol=1e-10)

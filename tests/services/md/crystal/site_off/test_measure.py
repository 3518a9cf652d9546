"""Forces and stresses of a strained crystal, against differences of LAMMPS's own energies."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mpi4py import MPI

from gimpmd_md.crystal.site_off.measure import forces, stress
from gimpmd_md.engines.lammps.site_off.double import with_off_sites
from gimpmd_schemas.mechanics.units import UNITS
from tests.services.md.crystal.site_off.crystals import SAMPLES, crystal, potential_of

F = np.array([[1.01, 0.004, -0.002], [0.006, 0.99, 0.003], [0.001, -0.005, 1.0]])


def test_forces_do_the_work_of_a_strain(tmp_path: Path) -> None:
    """Outer sites are off; the work of all forces is the stress of the sites that are on."""
    sample = SAMPLES["Cu eam/alloy"]
    potential = with_off_sites(potential_of(sample), 1, tmp_path)
    with crystal(sample, tmp_path) as cell:
        a = cell.box[1, 1] / 3
        P = stress(cell, F) / UNITS["metal"].nktv2p
        energies = []
        for step in (1e-5, -1e-5):
            R = np.linalg.qr(F + step * np.eye(3)[[1, 2, 0]])[1]
            R *= np.sign(np.diag(R))[:, None]
            energies.append(cell.deform(R)[0] / UNITS["metal"].nktv2p)
    slope = (energies[0] - energies[1]) / 2e-5
    np.testing.assert_allclose((P * np.eye(3)[[1, 2, 0]]).sum(), slope, rtol=1e-6)

    n = np.stack(np.meshgrid(*[np.arange(-8, 9)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    x = 0.5 * a * n[n.sum(axis=1) % 2 == 0]
    off = np.abs(x + 0.1).max(axis=1) > 2.1 * a
    found = forces(
        potential, "metal", x, np.ones(len(x), int), 1, off, [x @ F.T], MPI.COMM_SELF, tmp_path
    )
    volume = (~off).sum() * a**3 / 4
    np.testing.assert_allclose(-found[0].T @ x, P * volume, rtol=1e-9, atol=1e-9 * volume)
    np.testing.assert_allclose(found[0].sum(axis=0), 0.0, atol=1e-9)

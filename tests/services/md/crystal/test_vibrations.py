"""Thermal stress of crystals in LAMMPS, against exact values and lattice dynamics of bonds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from gimpmd_gimp.laws import thermal_stress as stress_of_bonds
from gimpmd_md.crystal.cell import open_cell
from gimpmd_md.crystal.vibrations import thermal_stress
from gimpmd_schemas.errors import BackendError
from tests.copper_sites import CELL, COPPER, SILICON, Metal
from tests.physics import lattice

SOFT = """\
units lj
dimension 3
boundary p p p
lattice fcc {density}
region box block 0 1 0 1 0 1
create_box 1 box
create_atoms 1 box
mass 1 1.0
pair_style born 1.2
pair_coeff 1 1 0.0 1.0 1.0 0.0 {strength}
"""
"""Nearest neighbours with the energy ``strength r^-8``."""

DENSITY = 2.0**0.5
"""Of a face-centred cubic crystal whose neighbours have the distance 1."""

HEXAGONAL = f"""\
units lj
dimension 2
boundary p p p
lattice hex {lattice.DENSITY!r}
region box block 0 2 0 1 -0.1 0.1
create_box 1 box
create_atoms 1 box
mass 1 1.0
pair_style lj/cut {lattice.CUTOFF}
pair_coeff 1 1 1.0 1.0
"""


def measured(script: str, folder: Path, dim: int) -> np.ndarray:
    path = folder / "cell.in"
    path.write_text(script)
    with open_cell(str(path), None, MPI.COMM_SELF, folder / "log.lammps", (dim,)) as cell:
        return thermal_stress(cell)


def test_soft_spheres_scale(tmp_path: Path) -> None:
    """All stiffnesses go as ``length^-10``, so ``S = -5 k T`` over the volume of an atom."""
    found = measured(SOFT.format(density=DENSITY, strength=1.0), tmp_path, 3)
    assert found[:3].mean() == pytest.approx(-5.0 * DENSITY, rel=1e-5)
    # the grid of wave vectors is not cubic
    np.testing.assert_allclose(found, [-5.0 * DENSITY] * 3 + [0.0] * 3, rtol=2e-4)


def test_a_hexagonal_crystal_is_that_of_its_bonds(tmp_path: Path) -> None:
    """The cell has four atoms, its primitive cell one."""
    bonds, energy = lattice.bonds()
    exact = stress_of_bonds(bonds, energy, lattice.AREA, 1.0)
    found = measured(HEXAGONAL, tmp_path, 2)
    np.testing.assert_allclose(found[:2], exact[:2], rtol=3e-5)
    assert found[2] == 0.0


def test_an_unstable_crystal_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(BackendError, match=r"cell\.in: continuum\.temperature: .* unstable"):
        measured(SOFT.format(density=DENSITY, strength=-1.0), tmp_path, 3)


WARM = """
replicate {times} {times} {times}
velocity all create {start} 4711 mom yes rot no
fix nve all nve
timestep 0.002
run 1000
reset_timestep 0
variable p equal (pxx+pyy+pzz)/3.0
compute T all temp
fix mean all ave/time 5 {samples} {steps} v_p c_T
run {steps}
variable pressure equal f_mean[1]
variable temperature equal f_mean[2]
"""


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("metal", "times", "T", "tolerance"), [(COPPER, 5, 100.0, 0.03), (SILICON, 3, 100.0, 0.05)]
)
def test_lammps_measures_the_same_pressure(
    metal: Metal, times: int, T: float, tolerance: float, tmp_path: Path
) -> None:
    """Molecular dynamics at constant volume for 20 ps.

    The theory is of first order in the temperature. Noise is about 1 %.
    """
    script = CELL.format(metal=metal) + metal.potential
    path = tmp_path / "cell.in"
    path.write_text(script)
    with open_cell(str(path), None, MPI.COMM_SELF, tmp_path / "log.lammps", (3,)) as cell:
        stress = thermal_stress(cell)
    with open_cell(str(path), None, MPI.COMM_SELF, tmp_path / "log.warm", (3,)) as cell:
        cell.deform(np.eye(3))
        words = WARM.format(times=times, start=2.0 * T, samples=2000, steps=10_000)
        cell.engine.commands(words.strip().splitlines())
        pressure, warm = (cell.engine.evaluate(f"v_{name}") for name in ("pressure", "temperature"))
    print(f"{warm:.1f} K, {pressure / warm:.2f} bar/K, theory {-stress[:3].mean():.2f}")
    assert pressure / warm == pytest.approx(-stress[:3].mean(), rel=tolerance)

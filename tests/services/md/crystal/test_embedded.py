"""The neighbours and tables of embedded atoms, as LAMMPS has them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from gimpmd_md.crystal import embedded
from gimpmd_md.crystal.cell import open_cell
from gimpmd_schemas.case.materials import Anisotropic, EmbeddedLattice
from gimpmd_schemas.errors import BackendError
from tests.copper_sites import ALUMINIUM_FS, COPPER, COPPER_FUNCFL, SILICON, Metal, write_scripts

LINEAR = Anisotropic(density=1.0, stiffness=tuple(tuple(row) for row in np.eye(6).tolist()))
FCC = 0.5 * np.array([[0.0, 1.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 0.0]])


def found_in(folder: Path, metal: Metal) -> EmbeddedLattice:
    """What LAMMPS measures of a cell; a sum that is not LAMMPS's is refused."""
    write_scripts(folder, metal)
    script, log = str(folder / "cell.in"), folder / "log.lammps"
    with open_cell(script, "metal", MPI.COMM_SELF, log, dims=(3,)) as cell:
        return embedded.of_cell(cell, LINEAR)


def test_half_of_the_neighbours_in_a_face_centred_cubic_crystal() -> None:
    """Shells of 12, 6, 24 and 12 neighbours, at squares of 1/2, 1, 3/2 and 2."""
    half = embedded.half_star(FCC, 1.5)
    squares, counts = np.unique((half**2).sum(axis=1).round(9), return_counts=True)
    np.testing.assert_array_equal(squares, [0.5, 1.0, 1.5, 2.0])
    np.testing.assert_array_equal(counts, [6, 3, 12, 6])
    assert len(np.unique(np.concatenate([half, -half]), axis=0)) == 54


@pytest.mark.parametrize("metal", [COPPER, COPPER_FUNCFL, ALUMINIUM_FS])
def test_the_sum_is_that_of_lammps(metal: Metal, tmp_path: Path) -> None:
    """For files of all three formats; the tables are those of the file."""
    found = found_in(tmp_path, metal)
    assert found.volume == pytest.approx(0.25 * metal.constant**3, rel=1e-9)
    assert len(found.pair) == len(found.cloud) >= 8 * found.cutoff / found.distance_step
    assert np.linalg.norm(found.bonds, axis=1).max() < embedded.REACH * found.cutoff


def test_a_sum_that_is_not_the_whole_energy_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(embedded, "REACH", 0.9)
    with pytest.raises(BackendError, match=r"cell.in: .* another potential besides"):
        found_in(tmp_path, COPPER)


def test_other_potentials_are_refused(tmp_path: Path) -> None:
    other = Metal("fcc", 4.0, "lj/cut 8", "0.3 2.55", "", 2.0, mass=60.0)
    with pytest.raises(BackendError, match=r"cell.in: model: lattice-sum is for pair_style eam"):
        found_in(tmp_path, other)


def test_a_lattice_with_a_basis_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BackendError, match=r"cell.in: the crystal has 2 atoms in its primitive"):
        found_in(tmp_path, SILICON)

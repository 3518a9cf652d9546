"""Moduli that LAMMPS measures, against lattice sums."""

from __future__ import annotations

from pathlib import Path

import pytest
from mpi4py import MPI

from gimpmd_md.crystal import moduli
from gimpmd_md.crystal.cell import open_cell
from gimpmd_schemas.case.materials import Elastic
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.mechanics.units import UNITS

DENSITY, C11, LAME = 0.9317984, 83.4995, 27.8332
"""Lattice sums of the hexagonal crystal, three shells within the cutoff of 2.5."""


def measure(script: Path, units: str) -> Elastic:
    with open_cell(script.name, units, MPI.COMM_SELF, script.with_name("log.lammps")) as cell:
        return moduli.measure(cell)


def test_hexagonal_lennard_jones(folder: Path) -> None:
    found = measure(folder / "cell.in", "lj")
    assert found.density == pytest.approx(DENSITY, rel=1e-6)
    assert found.lame == pytest.approx(LAME, rel=1e-5)
    assert found.shear == pytest.approx(LAME, rel=1e-5)
    assert found.lame + 2 * found.shear == pytest.approx(C11, rel=1e-5)


def test_other_units(folder: Path) -> None:
    sigma, epsilon, mass = 3.4, 0.0104, 39.95
    text = (folder / "cell.in").read_text()
    for name, value in {"scale": sigma, "style": "metal", "mass": mass, "epsilon": epsilon}.items():
        text = f"variable {name} index {value}\n" + text
    (folder / "cell.in").write_text(text)
    found = measure(folder / "cell.in", "metal")
    pressure = epsilon / sigma**2 * UNITS["metal"].nktv2p
    assert found.density == pytest.approx(DENSITY * mass / sigma**2, rel=1e-6)
    assert found.lame == pytest.approx(LAME * pressure, rel=1e-5)
    assert found.shear == pytest.approx(LAME * pressure, rel=1e-5)


def test_internal_freedom_is_relaxed(folder: Path) -> None:
    """Displaced atoms find back to their places before the stress is read."""
    text = (folder / "cell.in").read_text() + "displace_atoms all random 0.02 0.02 0 7\n"
    (folder / "cell.in").write_text(text)
    found = measure(folder / "cell.in", "lj")
    assert found.shear == pytest.approx(LAME, rel=1e-4)


@pytest.mark.parametrize(
    ("old", "new"),
    [("1.1132013035564605", "1.13"), ("stretch index 1.0", "stretch index 1.01")],
    ids=["too wide", "stretched"],
)
def test_a_cell_under_stress_is_refused(folder: Path, old: str, new: str) -> None:
    (folder / "cell.in").write_text((folder / "cell.in").read_text().replace(old, new))
    factor = {
        "1.13": "the lattice constant by 0.985133897",
        "stretch index 1.01": "y by 0.99009901",
    }
    with pytest.raises(BackendError, match=r"cell.in: the cell is under stress") as error:
        measure(folder / "cell.in", "lj")
    words = str(error.value)
    assert factor[new] in words
    assert "1.1132013 apart, their rows at 0 degrees to the x axis" in words


def test_a_cell_far_from_rest_is_refused(folder: Path) -> None:
    text = (folder / "cell.in").read_text().replace("1.1132013035564605", "1.4")
    (folder / "cell.in").write_text(text)
    with pytest.raises(BackendError, match=r"under stress .*no minimum between 0.85 and 1.15"):
        measure(folder / "cell.in", "lj")


def test_an_anisotropic_crystal_is_refused(folder: Path) -> None:
    """A square lattice of springs k (r - r0)^2: C11 = 2 (k1 + k2), C12 = C66 = 2 k2."""
    springs = "step(1.2-r)*50*(r-1)^2 + step(r-1.2)*10*(r-1.4142135623730951)^2"
    (folder / "square.in").write_text(
        "units lj\ndimension 2\nboundary p p p\natom_style atomic\nlattice sq 1.0\n"
        "region cell block 0 6 0 6 -0.5 0.5\ncreate_box 1 cell\ncreate_atoms 1 region cell\n"
        f"mass 1 1\npair_style lepton 1.6\npair_coeff 1 1 '{springs}'\n"
    )
    with pytest.raises(BackendError, match=r"not isotropic .* C11 = 120, .* C12 = 20, C66 = 20;"):
        measure(folder / "square.in", "lj")

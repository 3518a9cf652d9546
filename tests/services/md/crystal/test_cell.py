"""A cell that LAMMPS deforms, against sums over the lattice; cells that are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from gimpmd_md.crystal.cell import open_cell
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.mechanics.units import UNITS
from tests.physics import lattice

STRAINED = np.array([[1.02, 0.03], [0.0, 0.985]])
ARGON = {"scale": 3.4, "style": "metal", "mass": 39.95, "epsilon": 0.0104}


def opened(folder: Path, units: str = "lj"):
    return open_cell("cell.in", units, MPI.COMM_SELF, folder / "log.lammps")


def edit(folder: Path, old: str, new: str) -> None:
    path = folder / "cell.in"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def test_the_cell_of_the_script(folder: Path) -> None:
    with opened(folder) as cell:
        size = [8.0 * lattice.SPACING, 6.0 * 3**0.5 * lattice.SPACING]
        np.testing.assert_allclose(cell.box, np.diag(size), rtol=1e-12, atol=1e-13)
        assert cell.low == pytest.approx((0.0, 0.0), abs=1e-12)
        assert cell.density == pytest.approx(lattice.DENSITY, rel=1e-12)
        assert cell.tolerance is None  # the atoms of a Bravais lattice follow the strain


def test_energy_and_stress_are_the_sums_over_the_lattice(folder: Path) -> None:
    """Of F = 1 and of a strain in a direction without symmetry; the order does not matter."""
    with opened(folder) as cell:
        rest, before = cell.deform(np.eye(2))
        energy, tau = cell.deform(STRAINED)
        again, after = cell.deform(np.eye(2))
    W, exact = lattice.deform(STRAINED[None])
    assert energy - rest == pytest.approx(W[0], rel=1e-9)
    np.testing.assert_allclose(tau, exact[0], rtol=1e-9)
    assert np.abs(before).max() < 1e-8 * np.abs(tau).max()
    assert again == pytest.approx(rest, rel=1e-12)
    np.testing.assert_allclose(after, before, atol=1e-10)


def test_energy_and_stress_are_in_pressure_units(folder: Path) -> None:
    path = folder / "cell.in"
    lines = "".join(f"variable {name} index {value}\n" for name, value in ARGON.items())
    path.write_text(lines + path.read_text())
    pressure = 0.0104 / 3.4**2 * UNITS["metal"].nktv2p
    with opened(folder, "metal") as cell:
        rest, _ = cell.deform(np.eye(2))
        energy, tau = cell.deform(STRAINED)
        assert cell.density == pytest.approx(lattice.DENSITY * 39.95 / 3.4**2, rel=1e-9)
    W, exact = lattice.deform(STRAINED[None])
    assert energy - rest == pytest.approx(W[0] * pressure, rel=1e-6)
    np.testing.assert_allclose(tau, exact[0] * pressure, rtol=1e-6)


def test_displaced_atoms_find_back_to_their_places(folder: Path) -> None:
    path = folder / "cell.in"
    path.write_text(path.read_text() + "displace_atoms all random 0.02 0.02 0 7\n")
    with opened(folder) as cell:
        rest, _ = cell.deform(np.eye(2))
        energy, tau = cell.deform(STRAINED)
    W, exact = lattice.deform(STRAINED[None])
    assert energy - rest == pytest.approx(W[0], rel=1e-6)
    np.testing.assert_allclose(tau, exact[0], rtol=1e-4)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("boundary p p p", "boundary p s p", r"cell.in: the cell must be periodic"),
        ("pair_style lj/cut", "pair_style lj/cat", "lj/cat"),
        ("units ${style}", "units real", "cell.in: units real, but the case has units: lj"),
        ("create_atoms 1 region cell", "", "cell.in: makes no atoms"),
    ],
)
def test_bad_cells_are_refused(folder: Path, old: str, new: str, words: str) -> None:
    edit(folder, old, new)
    with pytest.raises(BackendError, match=words), opened(folder):
        pass


def test_a_solid_is_refused(folder: Path) -> None:
    (folder / "cell.in").write_text(
        "units lj\nlattice fcc 1.0\nregion b block 0 3 0 3 0 3\ncreate_box 1 b\n"
        "create_atoms 1 box\nmass 1 1\npair_style lj/cut 2.5\npair_coeff 1 1 1 1\n"
    )
    with pytest.raises(BackendError, match="the cell must have dimension 2"), opened(folder):
        pass


def test_lammps_is_closed_when_the_caller_fails(folder: Path) -> None:
    made = []

    def use() -> None:
        with opened(folder) as cell:
            made.append(cell.engine.lammps)
            assert made[0].lmp
            raise RuntimeError

    with pytest.raises(RuntimeError):
        use()
    assert not made[0].lmp

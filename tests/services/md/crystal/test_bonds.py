"""Bonds of the crystal in a cell, against the potential and lattice sums."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from gimpmd_md.crystal import bonds, bravais, moduli
from gimpmd_md.crystal.bonds import Bonds
from gimpmd_md.crystal.cell import Cell, open_cell
from gimpmd_schemas.mechanics.units import UNITS
from tests.physics import lattice


def edited(folder: Path, *changes: tuple[str, str]) -> None:
    """Replace words of the cell's script."""
    text = (folder / "cell.in").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "cell.in").write_text(text)


@pytest.fixture
def cell(folder: Path):
    """The cell, opened when the script is as the test wants it."""
    opened = []

    def _cell(units: str = "lj") -> Cell:
        opened.append(open_cell("cell.in", units, MPI.COMM_SELF, folder / "log.lammps"))
        return opened[-1].__enter__()

    yield _cell
    for context in opened:
        context.__exit__(None, None, None)


def test_the_lattice_of_a_cell(cell) -> None:
    vectors, kind = bonds.of_cell(cell())
    assert kind == 1
    a = lattice.SPACING
    np.testing.assert_allclose(vectors, [[a, 0.0], [a / 2, a * 3**0.5 / 2]], rtol=1e-14, atol=1e-15)


def test_a_cell_of_one_pair_of_atoms(folder: Path, cell) -> None:
    edited(folder, ("block 0 8 0 6", "block 0 1 0 1"))
    vectors, _ = bonds.of_cell(cell())
    assert bravais.area(vectors) == pytest.approx(lattice.AREA, rel=1e-14)


HONEYCOMB = (
    "lattice custom 0.7 a1 1.7320508075688772 0 0 a2 0 3 0 a3 0 0 1 basis 0 0 0 "
    "basis 0 0.333333333333333 0 basis 0.5 0.5 0 basis 0.5 0.833333333333333 0"
)


@pytest.mark.parametrize(
    "changes",
    [
        [("lattice hex ${lattice}", HONEYCOMB)],
        [
            ("create_box 1", "create_box 2"),
            ("mass 1", "mass *"),
            ("coeff 1 1", "coeff * *"),
            ("change_box", "set atom 3 type 2\nchange_box"),
        ],
        [("mass 1", "delete_atoms random count 1 yes all NULL 5\nmass 1")],
        [("lj/cut ${cutoff}", "lj/cut/coul/cut ${cutoff}"), ("style atomic", "style charge")],
    ],
    ids=["two in the cell", "two types", "vacancy", "charges"],
)
def test_other_crystals_are_none(folder: Path, cell, changes) -> None:
    edited(folder, *changes)
    assert bonds.of_cell(cell()) is None


def test_moduli_are_exact(cell) -> None:
    """C11 = 3 lambda and lambda = mu, of the sums over 4 (r^-12 - r^-6) by hand."""
    opened = cell()
    vectors, kind = bonds.of_cell(opened)
    found = moduli.of_bonds(opened, vectors, bonds.stable(opened, vectors, kind))
    R = lattice.NEIGHBOURS[np.hypot(*lattice.NEIGHBOURS.T) < lattice.CUTOFF]
    square = np.square(R).sum(axis=1)
    curvature = 4.0 * (42.0 * square**-8 - 12.0 * square**-5)  # by r^2
    shear = 2.0 / lattice.AREA * (curvature * R[:, 0] ** 2 * R[:, 1] ** 2).sum()
    assert found.shear == pytest.approx(shear, rel=1e-11)
    assert found.lame == pytest.approx(shear, rel=1e-11)
    assert found.density == pytest.approx(lattice.DENSITY, rel=1e-14)


def test_moduli_in_other_units(folder: Path, cell) -> None:
    sigma, epsilon, mass = 3.4, 0.0104, 39.95
    settings = {"scale": sigma, "style": "metal", "mass": mass, "epsilon": epsilon}
    text = "".join(f"variable {name} index {value}\n" for name, value in settings.items())
    (folder / "cell.in").write_text(text + (folder / "cell.in").read_text())
    opened = cell("metal")
    vectors, kind = bonds.of_cell(opened)
    found = moduli.of_bonds(opened, vectors, bonds.stable(opened, vectors, kind))
    measured = moduli.measure(opened)
    assert found.shear == pytest.approx(measured.shear, rel=1e-6)
    assert found.shear == pytest.approx(
        27.833155 * epsilon / sigma**2 * UNITS["metal"].nktv2p, rel=1e-7
    )


def test_other_forces_are_noticed(cell) -> None:
    """LAMMPS's stress is that of the bonds, and not that of bonds half as strong."""
    opened = cell()
    vectors, kind = bonds.of_cell(opened)
    found = bonds.stable(opened, vectors, kind)
    half = Bonds(found.vectors, [0.5 * c for c in found.energy], found.stretch_limit)
    assert bonds.is_whole(found, opened, bravais.area(vectors))
    assert not bonds.is_whole(half, opened, bravais.area(vectors))


def test_curvature_along_rays() -> None:
    """Two bonds along the axes, ``z^2 - 2 z^3``: at z = 0.1 the curvature is 2 - 12 z."""
    found = Bonds(np.eye(2), [np.array([0.0, 1.0, -2.0])] * 2, 0.1)
    assert bonds.least_curvature(found) == pytest.approx(1.0 - 6.0 * 0.1, rel=1e-2)


def test_the_reach_ends_before_a_neighbour_crosses_the_cutoff() -> None:
    """The third shell, at 2 a: s = (2.35 / 2.2264)^2 = 1.114."""
    vectors = lattice.SPACING * np.array([[1.0, 0.0], [0.5, 3**0.5 / 2]])
    assert bonds.stretch_limits(vectors, 2.5)[0] == 0.12
    assert bonds.stretch_limits(vectors, 2.35)[0] == 0.1
    assert bonds.stretch_limits(vectors, 2.8)[0] == 0.08  # the fourth shell at 2.945, pressed


def test_a_joined_potential_has_no_polynomial(folder: Path, cell) -> None:
    edited(
        folder,
        ("pair_style lj/cut ${cutoff}", "pair_style lj/smooth 1.15 ${cutoff}"),
    )
    opened = cell()
    vectors, kind = bonds.of_cell(opened)
    assert bonds.stable(opened, vectors, kind) is None

"""Surface energies that LAMMPS measures, against sums over the bonds that a surface cuts."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from gimpmd_md.crystal.surface import surfaces_of
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.mechanics.units import UNITS

Make = Callable[..., Case]

A, CUTOFF = 1.1132013035564605, 2.5
MEASURED = {"from": "md", "cell": "cell.in"}


def cut_bonds(axis: int) -> float:
    """``2 gamma = -sum phi(r) |r_n| / (2 A_atom)`` over the bonds of an atom.

    A plane cuts one bond of each kind on an area of ``A_atom / |r_n|``.
    """
    n = np.arange(-4, 5)
    i, j = (m.ravel() for m in np.meshgrid(n, n))
    bonds = np.stack([A * (i + 0.5 * j), A * np.sqrt(0.75) * j], axis=1)
    r = np.hypot(*bonds.T)
    near = (r > 0.0) & (r < CUTOFF)
    phi = 4.0 * (r[near] ** -12.0 - r[near] ** -6.0)
    return float(-0.5 * phi @ np.abs(bonds[near, axis]) / (A**2 * np.sqrt(0.75)))


def test_a_hexagonal_lennard_jones_crystal(folder: Path, make: Make) -> None:
    found = surfaces_of(make(continuum__material=MEASURED), MPI.COMM_SELF)
    assert [2.0 * gamma for gamma in found.unrelaxed] == pytest.approx(
        [cut_bonds(0), cut_bonds(1)], rel=1e-6
    )
    assert 2.0 * found.relaxed[1] == pytest.approx(2.182, abs=5e-4)
    # a surface of a pair potential relaxes by little, and only downward
    for cut, rest in zip(found.unrelaxed, found.relaxed, strict=True):
        assert 0.99 * cut < rest < cut


def test_where_the_layers_lie_in_the_cell_does_not_matter(folder: Path, make: Make) -> None:
    """A layer on the face of the cell is not cut in two; another is chosen."""
    text = (folder / "cell.in").read_text() + "displace_atoms all move 0.1 0.4 0 units box\n"
    (folder / "cell.in").write_text(text)
    found = surfaces_of(make(continuum__material=MEASURED), MPI.COMM_SELF)
    assert 2.0 * found.unrelaxed[1] == pytest.approx(cut_bonds(1), rel=1e-6)


def test_other_units(folder: Path, make: Make) -> None:
    sigma, epsilon, mass = 3.4, 0.0104, 39.95
    text = (folder / "cell.in").read_text()
    for name, value in {"scale": sigma, "style": "metal", "mass": mass, "epsilon": epsilon}.items():
        text = f"variable {name} index {value}\n" + text
    (folder / "cell.in").write_text(text)
    found = surfaces_of(make(units="metal", continuum__material=MEASURED), MPI.COMM_SELF)
    per = epsilon / sigma * UNITS["metal"].nktv2p
    assert 2.0 * found.unrelaxed[1] == pytest.approx(cut_bonds(1) * per, rel=1e-6)


def test_a_case_without_a_cell(make: Make) -> None:
    with pytest.raises(BackendError, match="names no cell"):
        surfaces_of(make(), MPI.COMM_SELF)

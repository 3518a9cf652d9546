"""Cells at zero pressure."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from gimpmd_md.crystal.cell import Cell, open_cell
from gimpmd_md.crystal.equilibrium import FACTORS, at_rest, near_rest, stiffness
from gimpmd_schemas.errors import BackendError

C11, LAME = 83.4995, 27.8332
"""Lattice sums of the hexagonal crystal."""


@contextmanager
def opened(folder: Path, *changes: tuple[str, str]) -> Iterator[Cell]:
    text = (folder / "cell.in").read_text()
    for old, new in changes:
        text = text.replace(old, new)
    (folder / "cell.in").write_text(text)
    with open_cell("cell.in", "lj", MPI.COMM_SELF, folder / "log.lammps") as cell:
        yield cell


def test_a_deformed_cell_comes_back_to_rest(folder: Path) -> None:
    """The cell is 2 % too wide, and stretched by another 1 % along y."""
    with opened(folder, ("1.1132013035564605", "1.13"), ("h index 1.0", "h index 1.01")) as cell:
        F, C = at_rest(cell, near_rest(cell, FACTORS) * np.eye(2))
        edges = np.diag(F @ cell.box)
        sigma = cell.deform(F)[1]
    a = 1.1132013035564605
    np.testing.assert_allclose(edges, [8 * a, 6 * 3**0.5 * a], rtol=1e-9)
    np.testing.assert_allclose(
        C, [[C11, LAME, 0], [LAME, C11, 0], [0, 0, LAME]], rtol=1e-5, atol=1e-6
    )
    assert np.abs(sigma).max() < 1e-7


def test_a_cell_far_from_rest(folder: Path) -> None:
    with (
        opened(folder, ("1.1132013035564605", "1.6")) as cell,
        pytest.raises(BackendError, match=r"cell.in: no crystal at zero pressure: .* between 0.85"),
    ):
        near_rest(cell, FACTORS)


def test_stiffness_of_a_cell_under_stress_is_the_change_of_stress(folder: Path) -> None:
    with opened(folder) as cell:
        F = 1.01 * np.eye(2)
        C = stiffness(cell, F)
        up, down = (cell.deform(1.01 * (1.0 + s) * np.eye(2))[1] for s in (1e-4, -1e-4))
        change = (up / (1.01 * 1.0001) ** 2 - down / (1.01 * 0.9999) ** 2) / 2e-4
    assert C[0, 0] + C[0, 1] == pytest.approx(change[0, 0], rel=1e-5)

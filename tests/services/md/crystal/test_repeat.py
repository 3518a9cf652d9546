"""How cells repeat: crystals whose shortest translations are known."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest
from mpi4py import MPI

from gimpmd_md.crystal.repeat import least_translation, repeat_of
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.errors import BackendError
from tests.copper_sites import CELL, COPPER_110, copper_case

Make = Callable[..., Case]

A = 1.1132013035564605
MEASURED = {"from": "md", "cell": "cell.in"}


def hexagonal(columns: int, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Two atoms in each of ``columns x rows`` cells of ``A x sqrt(3) A``, and the edges."""
    size = np.array([columns * A, rows * np.sqrt(3.0) * A])
    i, j = (n.ravel() for n in np.meshgrid(np.arange(2 * columns), np.arange(rows)))
    x = np.stack([0.5 * A * i, np.sqrt(3.0) * A * (j + 0.5 * (i % 2))], axis=1)
    return x, size


def test_hexagonal_cell(folder: Path, make: Make) -> None:
    found = repeat_of(make(continuum__material=MEASURED), MPI.COMM_SELF)
    assert found.period == pytest.approx((A, np.sqrt(3.0) * A), rel=1e-9)
    times = np.array(found.size) / found.period
    assert times == pytest.approx(np.round(times), abs=1e-9)
    assert found.low == pytest.approx((0.0, 0.0), abs=1e-12)


def test_a_cell_of_three_dimensions(folder: Path) -> None:
    """Copper with [110] along x and z: the lattice constant is a period along y only."""
    (folder / "cell.in").write_text(CELL.format(metal=COPPER_110) + COPPER_110.potential)
    case = copper_case((8, 2, 2), ((2.3, 8), None, None), 0.032, COPPER_110)
    found = repeat_of(msgspec.convert(case, Case), MPI.COMM_SELF)
    short = COPPER_110.constant / np.sqrt(2.0)
    assert found.period == pytest.approx((short, COPPER_110.constant, short), rel=1e-9)


@pytest.mark.parametrize(("columns", "rows"), [(1, 1), (5, 3), (8, 6)])
def test_translations_of_a_lattice_moved_at_will(columns: int, rows: int) -> None:
    x, size = hexagonal(columns, rows)
    x = (x + np.array([0.123, 0.456])) % size
    kind = np.ones(len(x), dtype=np.int32)
    assert least_translation(x, kind, size, 0) == pytest.approx(A)
    assert least_translation(x, kind, size, 1) == pytest.approx(np.sqrt(3.0) * A)


def test_types_and_defects_count() -> None:
    x, size = hexagonal(6, 4)
    kind = np.where(np.round(x[:, 0] / A).astype(int) % 2 == 0, 1, 2)
    alternating = least_translation(x, kind, size, 0)
    assert alternating == pytest.approx(2.0 * A)
    gap = np.delete(x, 7, axis=0)
    whole = least_translation(gap, np.ones(len(gap), dtype=np.int32), size, 0)
    assert whole == pytest.approx(size[0])


def test_a_tilted_cell_is_refused_with_a_way_out(folder: Path, make: Make) -> None:
    text = (folder / "cell.in").read_text() + "change_box all triclinic xy delta 1.1132 units box\n"
    (folder / "cell.in").write_text(text)
    with pytest.raises(BackendError, match=r"tilted.*two atoms"):
        repeat_of(make(continuum__material=MEASURED), MPI.COMM_SELF)

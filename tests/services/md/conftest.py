"""The atoms' side on the block of atoms."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from gimpmd_md.side import MdSide, open_side
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan
from tests.services.md.block import block_case

SCRIPTS = Path(__file__).parent / "scripts"


@pytest.fixture(scope="session")
def make() -> Callable[..., Case]:
    return block_case


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with the scripts."""
    for script in SCRIPTS.glob("*.in"):
        shutil.copy(script, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def start(folder: Path) -> Iterator[Callable[[Case], MdSide]]:
    """Start LAMMPS on a case, on one rank, and finish step 0; it is closed after the test."""
    from mpi4py import MPI

    sides = []

    def _start(case: Case) -> MdSide:
        sides.append(open_side(make_plan(case), MPI.COMM_SELF, Path()))
        sides[-1].finish()
        return sides[-1]

    yield _start
    for side in sides:
        side.close()


@pytest.fixture
def positions() -> Callable[[Case, np.ndarray], np.ndarray]:
    """Positions of nodes by id."""
    return lambda case, ids: make_plan(case).background_grid().positions()[ids]

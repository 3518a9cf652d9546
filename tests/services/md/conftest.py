"""Backends on the block of atoms."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gimpmd_schemas.case.form import Case
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
def start(folder: Path) -> Iterator[Callable[[Case], Any]]:
    """Start LAMMPS on a case, on one rank; closed after the test."""
    from mpi4py import MPI

    from gimpmd_md.engines.lammps.backend import LammpsBackend

    backends = []

    def _start(case: Case) -> LammpsBackend:
        backends.append(LammpsBackend(case, MPI.COMM_SELF, Path("log.lammps"), Path("atoms.dump")))
        return backends[-1]

    yield _start
    for backend in backends:
        backend.close()


@pytest.fixture
def positions() -> Callable[[Case, np.ndarray], np.ndarray]:
    """Positions of nodes by id."""
    return lambda case, ids: case.background_grid().positions()[ids]

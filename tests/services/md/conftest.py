"""A small block of atoms in a continuum, and backends on it."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from gimpmd_schemas.case import Case

SCRIPTS = Path(__file__).parent / "scripts"

BLOCK: dict[str, Any] = {
    "gimpmd": 1,
    "name": "block",
    "units": "lj",
    "domain": {"box": [[0, 52], [0, 52]]},
    "grid": {"cell": 2.6},
    "time": {"end": 8, "md_timestep": 0.002, "md_steps": 20},
    "md": {"region": [[13, 39], [13, 39]], "input": "block.in"},
    "continuum": {
        "material": {"from": "case", "density": 0.9317984, "lame": 27.8332, "shear": 27.8332},
    },
    "output": {"interval": 1000},
}
"""Atoms 26 by 26 in the middle of a continuum; interfaces all around."""


def block_case(**changes: Any) -> Case:
    """The block with ``section__key=value`` set."""
    raw = deepcopy(BLOCK)
    for path, value in changes.items():
        *parents, last = path.split("__")
        place = raw
        for parent in parents:
            place = place.setdefault(parent, {})
        place[last] = value
    return msgspec.convert(raw, Case)


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

    from gimpmd_md.lammps_backend import LammpsBackend

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

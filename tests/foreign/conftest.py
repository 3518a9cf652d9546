"""The service in Rust, and a short strip in which a wave enters the atoms."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import dump_case
from tests.cases import changed
from tests.physics.interface import packets
from tests.physics.sides import PROGRAM, WAVE
from tests.physics.strips import CELL, SCRIPT, ground

CRATE = PROGRAM.parents[2]
STEPS = 60
"""Coupling steps of the short strip: the packet has entered the atoms by half."""

SAME = 1e-9
"""Largest difference of two codes with the same elements and steps, relative to the largest value:
sums in another order, over the steps of the strip."""

OURS: dict[str, Any] = {"continuum__command": [], "continuum__backend": "fem"}
"""Changes that put our finite elements in the place of the program."""


@pytest.fixture(scope="session", autouse=True)
def _built() -> None:
    """Build the program."""
    subprocess.run(["cargo", "build", "--release", "--quiet"], cwd=CRATE, check=True)


Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Write the short strip with changes by dotted key; return the case file."""

    def write_changed(**changes: Any) -> Path:
        values = packets.strip("force", WAVE, "into")
        step = 16 * 0.005
        values["continuum"]["command"] = [str(PROGRAM)]
        values["time"]["end"] = values["output"]["interval"] = STEPS * step
        values["initial"]["packets"][0]["center"] = values["md"]["region"][0][0]
        dotted = {key.replace("__", "."): value for key, value in changes.items()}
        case = msgspec.convert(changed(values, dotted), Case)
        for script in CELL.parent.glob("*.in"):
            (tmp_path / script.name).write_text(script.read_text())
        (tmp_path / SCRIPT).write_text(ground().lammps(case))
        dump_case(case, tmp_path / "case.yaml")
        return tmp_path / "case.yaml"

    return write_changed

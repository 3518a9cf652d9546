"""A small sound case, and the command line in this process."""

import copy
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.testing import CliRunner, Result

from gimpmd_deploy.cli.app import app

ATOMS = """\
variable xlo index 0
variable xhi index 60
variable ylo index 0
variable yhi index 80
units lj
dimension 2
boundary s s p
atom_style atomic
variable a equal 1.1132013035564605
variable density equal 2/(sqrt(3)*v_a^2)
lattice hex ${density} origin 0.25 0.25 0
region box block ${xlo} ${xhi} ${ylo} ${yhi} -0.5 0.5 units box
create_box 1 box
create_atoms 1 region box
mass 1 1
pair_style lj/cut 2.5
pair_coeff 1 1 1 1
"""

CASE: dict[str, Any] = {
    "gimpmd": 1,
    "name": "block",
    "units": "lj",
    "domain": {"box": [[0, 120], [0, 80]]},
    "grid": {"cell": 4, "points_per_axis": 2},
    "time": {"end": 0.8, "md_timestep": 0.002, "md_steps": 40},
    "md": {"region": [[0, 60], [0, 80]], "input": "atoms.in"},
    "coupling": {"scheme": "velocity"},
    "continuum": {
        "material": {"from": "moduli", "density": 0.9318, "lame": 27.83, "shear": 27.83},
        "threads": 1,
    },
    "boundary": {"right": {"condition": "traction", "value": [0.1, 0], "ramp": 0.2}},
    "output": {"interval": 0.4},
}

REMOVE = object()
"""Stands for a key that is to be left out."""


def changed(case: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """A copy of a case with values replaced by dotted key."""
    case = copy.deepcopy(case)
    for key, value in changes.items():
        *parents, last = key.split(".")
        part = case
        for parent in parents:
            part = part.setdefault(parent, {})
        if value is REMOVE:
            del part[last]
        else:
            part[last] = value
    return case


@dataclass
class Bench:
    """A folder with a case, and the command line."""

    folder: Path

    def write(self, changes: dict[str, Any] | None = None, script: str = ATOMS) -> Path:
        path = self.folder / "case.yaml"
        path.write_text(yaml.safe_dump(changed(CASE, changes or {})))
        (self.folder / "atoms.in").write_text(script)
        return path

    def gimpmd(self, *words: object) -> Result:
        return CliRunner().invoke(app, [str(word) for word in words])

    @property
    def runs(self) -> Path:
        return self.folder / "runs"


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Bench:
    monkeypatch.chdir(tmp_path)
    return Bench(tmp_path)


@pytest.fixture
def no_services(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Any attempt to start a service of a run fails the test."""

    def refuse(*_: object, **__: object) -> None:
        pytest.fail("a service was started")

    monkeypatch.setattr("gimpmd_deploy.launch.supervise.start", refuse)
    return lambda: None

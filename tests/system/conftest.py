"""Whole runs by the command: a small cracked body, about 1,000 atoms."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "mode1-small"


def small_case() -> dict[str, Any]:
    """Return the example's case, shrunk to a domain of 64 x 64 with cells of 2."""
    case = yaml.safe_load((EXAMPLE / "case.yaml").read_text())
    case["name"] = "small"
    case["domain"]["box"] = [[0, 64], [0, 64]]
    case["grid"]["cell"] = 2
    case["time"] = {"end": 2.0, "md_timestep": 0.002, "md_steps": 20}
    case["md"]["region"] = [[0, 33], [14.5, 49.5]]
    case["md"]["variables"] = {"crack_length": 12, "crack_plane": 32}
    case["continuum"]["cracks"] = [{"from": [0, 32], "to": [12, 32]}]
    case["continuum"]["material"] = {
        "from": "moduli",
        "density": 0.9317984,
        "lame": 27.83316,
        "shear": 27.83316,
    }
    case["output"]["interval"] = 1.0
    for face in ("top", "bottom"):
        case["boundary"][face]["ramp"] = 1
    return case


class Command:
    """The command on a case in a folder of its own, with the example's scripts beside it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir()
        for script in EXAMPLE.glob("*.in"):
            (folder / script.name).write_text(script.read_text())

    def write(self, case: dict[str, Any]) -> Path:
        """Write the case file."""
        path = self.folder / "case.yaml"
        path.write_text(yaml.safe_dump(case))
        return path

    def arguments(self, *words: str) -> list[str]:
        """Return the command line."""
        return [sys.executable, "-m", "gimpmd_deploy.cli.app", *words]

    def attempt(
        self, case: dict[str, Any], *options: str, name: str = "run", timeout: float = 200
    ) -> subprocess.CompletedProcess[str]:
        """Run the case, however it ends."""
        out = str(self.folder / name)
        return subprocess.run(
            self.arguments("run", str(self.write(case)), "--out", out, *options),
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
        )

    def run(self, case: dict[str, Any], *options: str, name: str = "run") -> Path:
        """Run the case to its end; returns the run folder."""
        done = self.attempt(case, *options, name=name)
        assert done.returncode == 0, done.stdout + done.stderr
        return self.folder / name


@pytest.fixture
def command(tmp_path):
    """A ``Command`` in a fresh folder."""
    return Command(tmp_path / "case")


@pytest.fixture
def case():
    """The small case, to change at will."""
    return small_case()

"""Other codes in whole runs: a wave crosses the interface between a toy and the usual code."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest

from gimpmd_deploy.verify.crossing import crossing
from gimpmd_deploy.verify.strips import Wave
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import dump_case
from tests.physics.interface import packets
from tests.physics.strips import run_case

ROOT = Path(__file__).parents[2]
WAVE = Wave(20.0, "P")
"""The shortest wave for which both R and T of the velocity scheme have bounds."""


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Install the toy codes for the processes of a run: a package with entry points."""
    package = tmp_path / "installed" / "toy-1.dist-info"
    package.mkdir(parents=True)
    (package / "METADATA").write_text("Metadata-Version: 2.1\nName: toy\nVersion: 1\n")
    (package / "entry_points.txt").write_text(
        "[gimpmd.md]\ntoy = tests.services.md.toy_atoms:ToyAtoms\n"
        "[gimpmd.continuum]\ntoy = tests.services.gimp.toy_continuum:ToyContinuum\n"
    )
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(package.parent), str(ROOT)]))


def strip(way: Any, **md: Any) -> dict[str, Any]:
    case = packets.strip("velocity", WAVE, way)
    case["md"] |= md
    return case


@pytest.mark.long
@pytest.mark.parametrize("way", ["into", "out"])
def test_a_wave_crosses_to_and_from_toy_atoms(toy: None, tmp_path: Path, way: Any) -> None:
    """The bounds are those of LAMMPS."""
    grid = run_case(strip("into"), tmp_path / "grid", "--only", "continuum")
    run = run_case(strip(way, backend="toy"), tmp_path / way)
    R, T = crossing(run)
    checks = packets.judged("velocity", WAVE, way, (R, T), crossing(grid))
    print(f"{way}: R = {R:.5f}, T = {T:.5f}")
    assert len(checks) == 2
    assert all(check.passed for check in checks), checks


@pytest.mark.long
@pytest.mark.parametrize("way", ["into", "out"])
def test_a_wave_crosses_to_and_from_a_toy_continuum(toy: None, tmp_path: Path, way: Any) -> None:
    """The bounds are those of GIMP."""
    case = packets.strip("force", WAVE, way)
    grid = run_case(packets.strip("force", WAVE, "into"), tmp_path / "grid", "--only", "continuum")
    case["continuum"] |= {"backend": "toy"}
    run = run_case(case, tmp_path / way)
    R, T = crossing(run)
    checks = packets.judged("force", WAVE, way, (R, T), crossing(grid))
    print(f"{way}: R = {R:.5f}, T = {T:.5f}")
    assert checks
    assert all(check.passed for check in checks), checks


def test_an_unknown_code_is_refused_before_the_run(tmp_path: Path) -> None:
    case = msgspec.convert(strip("into", backend="none"), Case)
    (tmp_path / "strip.in").write_text("")
    (tmp_path / "cell.in").write_text("")
    dump_case(case, tmp_path / "case.yaml")
    command = [sys.executable, "-m", "gimpmd_deploy.cli.app", "run", "case.yaml", "--out", "run"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "md.backend = 'none': no such code is installed (installed: ase, lammps)" in done.stderr
    assert not (tmp_path / "run").exists()

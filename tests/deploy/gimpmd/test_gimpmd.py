"""The package for Python users, and the page that describes it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest
import yaml

import gimpmd
from tests.cases import CASE, CONTINUUM_ONLY, changed

PAGE = Path(__file__).parents[3] / "docs" / "python.md"
CONTINUUM = CONTINUUM_ONLY | {"time": {"end": 0.5}}


@pytest.fixture
def case(tmp_path: Path) -> Path:
    path = tmp_path / "case.yaml"
    path.write_text(yaml.safe_dump(changed(CASE, CONTINUUM)))
    return path


def test_all_problems_of_a_case_at_once(case: Path) -> None:
    case.write_text(yaml.safe_dump(changed(CASE, CONTINUUM | {"grid.cell": -1, "time.end": -2})))
    with pytest.raises(gimpmd.InputError, match="2 problems") as caught:
        gimpmd.load(case)
    assert [problem.key for problem in caught.value.problems] == ["grid.cell", "time.end"]


def test_run_of_a_case_that_was_changed(case: Path, capfd: pytest.CaptureFixture[str]) -> None:
    loaded = gimpmd.load(case)
    time = msgspec.structs.replace(loaded.time, end=0.25)
    output = msgspec.structs.replace(loaded.output, interval=0.25)
    shorter = msgspec.structs.replace(loaded, time=time, output=output)
    run = gimpmd.run(shorter, case.parent / "run")
    assert capfd.readouterr().out == ""
    assert run.outcome == "completed"
    assert run.case == shorter
    energies = run.energies
    assert 0.25 <= energies.time[-1] < 0.5
    balance = energies.energy - energies.external_work
    assert np.abs(balance).max() < 0.05 * energies.external_work[-1]
    with pytest.raises(gimpmd.InputError, match="--force"):
        gimpmd.run(case, case.parent / "run")


def test_a_bad_case_is_not_run(case: Path) -> None:
    with pytest.raises(gimpmd.InputError, match=r"continuum\.ranks = 601"):
        gimpmd.run(case, case.parent / "run", ranks_gimp=601)
    assert not (case.parent / "run").exists()


def test_open_a_finished_run(runs: Path) -> None:
    run = gimpmd.open(str(runs / "block"))
    assert repr(run) == f"Run('{runs / 'block'}')"
    assert run.atoms().velocity.shape == run.atoms().position.shape


def test_the_page_runs(tmp_path: Path) -> None:
    """All Python blocks of the page, one after the other in one process, as in a notebook."""
    found = re.findall(r"^```(\w*)\n(.*?)^```", PAGE.read_text("utf-8"), re.DOTALL | re.M)
    blocks = [text for language, text in found if language == "python"]
    said = [text for language, text in found if language == ""]
    assert len(blocks) >= 5
    done = subprocess.run(
        [sys.executable, "-c", "\n".join(blocks)],
        cwd=tmp_path,
        env=os.environ | {"MPLBACKEND": "Agg"},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "".join(said) == done.stdout

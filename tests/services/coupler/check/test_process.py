"""The service that is checked, as a process."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import psutil
import pytest

from gimpmd_coupler.check.process import started
from gimpmd_schemas.errors import BackendError


def test_its_end_and_its_words_are_known(tmp_path: Path) -> None:
    program = "import sys; print('one'); print('two', file=sys.stderr); sys.exit(3)"
    log = tmp_path / "log"
    with started([sys.executable, "-c", program], tmp_path, log) as process:
        assert process.wait(20.0)
        assert process.code == 3
        assert "one" in process.said()
        assert process.state().endswith("(exit code 3); it said last: two")


def test_it_starts_in_its_folder(tmp_path: Path) -> None:
    program = "import os; print(os.getcwd())"
    with started([sys.executable, "-c", program], tmp_path, tmp_path / "log") as process:
        assert process.wait(20.0)
    assert process.said().strip() == str(tmp_path.resolve())


def test_nothing_of_it_is_left(tmp_path: Path) -> None:
    inner = "import time; time.sleep(100)"
    program = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {inner!r}])"
    with started([sys.executable, "-c", program], tmp_path, tmp_path / "log") as process:
        assert process.state() == "the service runs"
        until, family = time.monotonic() + 20.0, []
        while not family and time.monotonic() < until:
            time.sleep(0.05)
            family = [p for p in psutil.Process().children(recursive=True) if inner in p.cmdline()]
    assert family
    psutil.wait_procs(family, timeout=5.0)
    assert not any(p.is_running() and p.status() != psutil.STATUS_ZOMBIE for p in family)


def test_a_command_that_does_not_exist(tmp_path: Path) -> None:
    with (
        pytest.raises(BackendError, match="/no/such/program cannot be started: No such file"),
        started(["/no/such/program"], tmp_path, tmp_path / "log"),
    ):
        pass

"""One process of a service: its start, its end, and the end of its log."""

import sys
from pathlib import Path

import pytest

from gimpmd_deploy.launch import processes
from gimpmd_deploy.launch.processes import Service, end_all, last_words, mpiexec, start
from gimpmd_schemas.errors import BackendError, PeerLostError


def service(folder: Path, program: str) -> Service:
    return Service("md", [sys.executable, "-c", program], folder / "logs" / "md.log", folder)


def test_output_goes_to_the_log(tmp_path):
    child = start(service(tmp_path, "import sys; print('hello'); sys.exit(4)"))
    child.process.wait(timeout=20)
    assert child.failed()
    assert child.how().startswith("ended with exit code 4\nend of ")
    assert child.how().endswith("hello")


def test_processes_are_ended(tmp_path):
    child = start(service(tmp_path, "import time; time.sleep(60)"))
    assert child.running()
    end_all([child], terminate=5.0, kill=1.0)
    assert child.how() == "was killed by SIGTERM"


def test_a_command_that_does_not_exist(tmp_path):
    missing = Service("coupler", ["/nowhere/gimpmd"], tmp_path / "log", tmp_path)
    with pytest.raises(PeerLostError, match="coupler cannot be started: No such file"):
        start(missing)


def test_last_words_leave_out_tracebacks_and_progress(tmp_path):
    log = tmp_path / "md.log"
    log.write_text(
        "2025 INFO step 1\nTraceback (most recent call last):\n  File 'x'\nValueError: no pair\n"
    )
    assert last_words(log) == f"end of {log}:\n    ValueError: no pair"
    assert last_words(tmp_path / "none.log") == ""


def test_without_mpiexec(monkeypatch, tmp_path):
    assert Path(mpiexec()).exists()
    monkeypatch.setattr(processes.sys, "executable", str(tmp_path / "python"))
    with pytest.raises(BackendError, match="pip install mpich"):
        mpiexec()

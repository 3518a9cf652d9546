"""Runs a function of a test file on several MPI ranks."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

CALL = "import runpy, sys; runpy.run_path(sys.argv[1])[sys.argv[2]](*sys.argv[3:])"


def on_ranks(count: int, file: str, function: str, *arguments: str) -> None:
    """Call ``function(*arguments)`` of a file on each rank; its failure is the test's."""
    launcher = shutil.which("mpiexec", path=f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    if launcher is None:
        pytest.skip("mpiexec is not installed")
    command = [launcher, "-n", str(count), sys.executable, "-c", CALL, file, function, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stdout + done.stderr

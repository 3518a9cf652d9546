"""The process of the continuum service."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan, write_plan
from tests.cases import CASE, changed
from tests.mpi import MPIEXEC

KILLED = 9
"""Code of mpiexec when it learns first of a rank that it killed."""

ELSEWHERE = """
import os, runpy, sys
if os.environ["PMI_RANK"] == "1":
    sys.argv[sys.argv.index("--run-dir") + 1] = "/nowhere"
runpy.run_module("gimpmd_gimp.service", run_name="__main__")
"""


@pytest.mark.timeout(60)
def test_a_rank_that_cannot_read_the_plan_ends_all_ranks(tmp_path: Path) -> None:
    """As on a host without the run folder. The others wait for it in the start of MPI."""
    case = msgspec.convert(changed(CASE, {"continuum.ranks": 2}), Case)
    write_plan(make_plan(case), tmp_path / "plan.yaml")
    bus = f"unixsock-stream/{tmp_path / 'bus'}"
    options = ["--run-dir", str(tmp_path), "--run", "test", "--connect", bus]
    words = [MPIEXEC, "-n", "2", sys.executable, "-c", ELSEWHERE, *options]
    ended = subprocess.run(words, capture_output=True, text=True, check=False, timeout=40)
    assert ended.returncode in {2, KILLED}
    assert "/nowhere/plan.yaml" in ended.stderr

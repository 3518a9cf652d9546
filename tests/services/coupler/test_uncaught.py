"""A rank that ends before it has started MPI does not leave the others waiting."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

MPIEXEC = str(Path(sys.executable).parent / "mpiexec")

SCRIPT = """
import os
import gimpmd_md
if os.environ.get("PMI_RANK", "1") == "1":
    raise MemoryError("while numpy is imported")
from mpi4py import MPI
MPI.COMM_WORLD.Barrier()
"""


@pytest.mark.timeout(60)
def test_an_error_while_a_rank_is_imported_ends_all_ranks() -> None:
    """Once the others waited for ever, and the run for its deadline."""
    words = [MPIEXEC, "-n", "2", sys.executable, "-c", SCRIPT]
    ended = subprocess.run(words, capture_output=True, text=True, check=False, timeout=30)
    assert ended.returncode == 9
    assert "MemoryError: while numpy is imported" in ended.stderr


def test_a_program_that_is_no_rank_ends_as_usual() -> None:
    words = [sys.executable, "-c", SCRIPT]
    alone = {key: value for key, value in os.environ.items() if not key.startswith("PMI_")}
    ended = subprocess.run(words, capture_output=True, text=True, check=False, env=alone)
    assert ended.returncode == 1
    assert "MemoryError: while numpy is imported" in ended.stderr

"""How the ranks of a service end together."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from gimpmd_coupler.exit import exit_code_of
from gimpmd_schemas.errors import InputError, PeerLostError
from tests.mpi import MPIEXEC

SCRIPT = """
import sys, time
from mpi4py import MPI
from gimpmd_coupler import exit
from gimpmd_schemas.errors import InputError, PeerLostError
exit.FAREWELL_SECONDS = 1.0
errors = {"input": InputError("case.yaml", []), "lost": PeerLostError("gone")}
word = sys.argv[1 + MPI.COMM_WORLD.rank]
comm = MPI.COMM_WORLD.Dup()
if word == "sleep":
    time.sleep(60)
sys.exit(exit.exit_together(comm, errors[word], "gimpmd-test"))
"""

KILLED = 9
"""Code of MPICH's mpiexec when it learns of the end of a rank that it killed before that of the
rank that called MPI_Abort; about one time in four on two cores."""


def test_exit_codes() -> None:
    assert exit_code_of(InputError("case.yaml", [])) == 2
    assert exit_code_of(PeerLostError("gone")) == 3
    assert exit_code_of(RuntimeError("a bug")) == 3


@pytest.mark.timeout(60)
@pytest.mark.parametrize(
    ("words", "codes"),
    [
        (("lost", "lost"), {3}),
        (("lost", "input"), {2}),
        (("lost", "sleep"), {3, KILLED}),
        (("sleep", "input"), {2, KILLED}),
    ],
)
def test_all_ranks_end_with_the_code_of_the_cause(words: tuple[str, str], codes: set[int]) -> None:
    ended = subprocess.run(
        [
            MPIEXEC,
            "-n",
            "2",
            sys.executable,
            "-c",
            SCRIPT,
            *words,
        ],
        capture_output=True,
        text=True,
        check=False,
        timeout=50,
    )
    assert ended.returncode in codes, ended.stderr
    assert "gimpmd-test: " in ended.stderr


IMPORTS = """
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
    words = [MPIEXEC, "-n", "2", sys.executable, "-c", IMPORTS]
    ended = subprocess.run(words, capture_output=True, text=True, check=False, timeout=30)
    assert ended.returncode == 9
    assert "MemoryError: while numpy is imported" in ended.stderr


def test_a_program_that_is_no_rank_ends_as_usual() -> None:
    words = [sys.executable, "-c", IMPORTS]
    alone = {key: value for key, value in os.environ.items() if not key.startswith("PMI_")}
    ended = subprocess.run(words, capture_output=True, text=True, check=False, env=alone)
    assert ended.returncode == 1
    assert "MemoryError: while numpy is imported" in ended.stderr

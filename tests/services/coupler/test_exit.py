"""How the ranks of a service end together."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from gimpmd_coupler.exit import exit_code_of
from gimpmd_schemas.errors import InputError, PeerLostError

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


def test_exit_codes() -> None:
    assert exit_code_of(InputError("case.yaml", [])) == 2
    assert exit_code_of(PeerLostError("gone")) == 3
    assert exit_code_of(RuntimeError("a bug")) == 3


@pytest.mark.timeout(60)
@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("lost", "lost"), 3),
        (("lost", "input"), 2),
        (("lost", "sleep"), 3),
        (("sleep", "input"), 2),
    ],
)
def test_all_ranks_end_with_the_code_of_the_cause(words: tuple[str, str], code: int) -> None:
    ended = subprocess.run(
        [
            str(Path(sys.executable).parent / "mpiexec"),
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
    assert ended.returncode == code, ended.stderr
    assert "gimpmd-test: " in ended.stderr

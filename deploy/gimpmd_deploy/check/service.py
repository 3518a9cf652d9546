"""Checks a service: prepares the bodies, and starts the process that plays the other sides."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec

from gimpmd_deploy.check.cases import BODIES, Checkup, prepare
from gimpmd_deploy.launch.processes import ENVIRONMENT, mpiexec
from gimpmd_deploy.launch.services import with_full_paths
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.errors import BackendError, PeerLostError
from gimpmd_schemas.wire.conformance import Checked, Group

CHECKER = "gimpmd_coupler.check"


def command_of(side: Role, words: Sequence[str], ranks: int) -> list[str]:
    """Command that starts a service on its ranks.

    Parameters
    ----------
    side : Role
    words : sequence of str
        Command of one rank; empty: that of the service that comes with gimpmd.
    ranks : int

    Raises
    ------
    BackendError
        The service needs MPI, and there is no ``mpiexec``.
    """
    own = {"md": ["gimpmd_md.service", "serve"], "continuum": ["gimpmd_gimp.service"]}
    command = with_full_paths(words) or [sys.executable, "-m", *own[side]]
    needs_mpi = ranks > 1 or (side == "md" and not words)
    return [mpiexec(), "-n", str(ranks), *command] if needs_mpi else command


def check_service(
    checkup: Checkup,
    words: Sequence[str],
    out: Path,
    *,
    body: str,
    case: Path | None,
    free_case: Path | None,
    groups: Sequence[Group],
    deadline: float,
) -> Iterator[Checked]:
    """Check a service, and yield each result as it comes.

    Parameters
    ----------
    checkup : Checkup
    words : sequence of str
        Command of a rank; empty: the service of gimpmd. Words that name files are made full paths.
    out : Path
        Folder for the run folders, with the logs of the service. It must be empty.
    body : str
        A name in `cases.BODIES`.
    case, free_case : Path, optional
        Cases in place of those of the body. If only the first is given, there is no check of a free
        body.
    groups : sequence of str
        The groups of checks to make.
    deadline : float
        Seconds for each thing that the service should do.

    Raises
    ------
    InputError, BackendError
        A case cannot be used, or the command cannot be started.
    PeerLostError
        The process that makes the checks has failed.
    """
    coupled, free = BODIES[body]
    side, ranks = checkup.side, checkup.ranks
    prepare(case or coupled, checkup, False, out / "strip")
    options = ["--side", side, "--strip", str(out / "strip"), "--out", str(out / "runs")]
    if free_case or case is None:
        prepare(free_case or free, checkup, True, out / "block")
        options += ["--block", str(out / "block")]
    if case is None and (ranks > 1 or body != "strip"):
        options.append("--may-refuse")
    options += ["--deadline", repr(deadline), "--groups", ",".join(groups)]
    yield from _results([*options, "--", *command_of(side, words, ranks)])


def _results(options: list[str]) -> Iterator[Checked]:
    process = subprocess.Popen(
        [sys.executable, "-m", CHECKER, *options],
        env=os.environ | ENVIRONMENT,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    with process:
        assert process.stdout is not None
        assert process.stderr is not None
        try:
            for line in process.stdout:
                yield msgspec.json.decode(line, type=Checked)
        except BaseException:
            process.terminate()  # it ends the service
            raise
        said = process.stderr.read().strip()
    if process.returncode == BackendError.exit_code:
        raise BackendError(said)
    if process.returncode != 0:
        last = said.splitlines()[-1] if said else "it gave no reason"
        raise PeerLostError(f"the check ended with exit code {process.returncode}: {last}")

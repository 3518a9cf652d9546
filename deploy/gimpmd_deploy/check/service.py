"""Checks a service: prepares the bodies, and starts the process that plays the other sides."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec

from gimpmd_deploy.check.cases import BLOCK, STRIP, prepare
from gimpmd_deploy.launch.processes import ENVIRONMENT, mpiexec
from gimpmd_deploy.launch.services import with_full_paths
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.errors import BackendError, PeerLostError
from gimpmd_schemas.wire.conformance import Checked, Group

CHECKER = "gimpmd_coupler.check"


def own_command(side: Role) -> list[str]:
    """Command of the service of a side that comes with gimpmd.

    Raises
    ------
    BackendError
        The MD service needs MPI, and there is no ``mpiexec``.
    """
    if side == "md":
        return [mpiexec(), "-n", "1", sys.executable, "-m", "gimpmd_md.service", "serve"]
    return [sys.executable, "-m", "gimpmd_gimp.service"]


def check_service(
    side: Role,
    words: Sequence[str],
    out: Path,
    *,
    backend: str | None,
    case: Path | None,
    free_case: Path | None,
    groups: Sequence[Group],
    deadline: float,
) -> Iterator[Checked]:
    """Check a service, and yield each result as it comes.

    Parameters
    ----------
    side : Role
        Of the service.
    words : sequence of str
        Its command; empty: the service of gimpmd. Words that name files are made full paths.
    out : Path
        Folder for the run folders, with the logs of the service. It must be empty.
    backend : str, optional
        Code that runs the side, in place of that of the case.
    case, free_case : Path, optional
        Cases in place of those that come with gimpmd. If only the first is given, there is no check
        of a free body.
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
    prepare(case or STRIP, side, backend, False, out / "strip")
    free = free_case or (BLOCK if case is None else None)
    options = ["--side", side, "--strip", str(out / "strip"), "--out", str(out / "runs")]
    if free is not None:
        prepare(free, side, backend, True, out / "block")
        options += ["--block", str(out / "block")]
    options += ["--deadline", repr(deadline), "--groups", ",".join(groups)]
    yield from _results([*options, "--", *(with_full_paths(words) or own_command(side))])


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

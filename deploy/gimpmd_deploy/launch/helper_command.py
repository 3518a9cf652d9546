"""Helper commands of services: they answer a question about a case before it runs."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import msgspec

from gimpmd_deploy.launch.folder import copy_input
from gimpmd_deploy.launch.processes import ENVIRONMENT
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import dump_json
from gimpmd_schemas.errors import BackendError, PeerLostError, StorageError

Answer = TypeVar("Answer")


@contextmanager
def folder_of_case(case: Case, path: Path) -> Iterator[Path]:
    """Make a temporary folder with ``case.yaml`` and the files that the case names.

    Parameters
    ----------
    path : Path
        The case file, beside which these files are.
    """
    with tempfile.TemporaryDirectory(prefix="gimpmd-probe-") as name:
        folder = Path(name)
        copy_input(case, path.parent, folder)
        dump_json(case, folder / "case.yaml")
        yield folder


def run_helper(
    words: Sequence[str],
    folder: Path,
    *,
    about: str,
    service: str,
    question: str,
    seconds: float,
    too_slow: str,
) -> str:
    """Run a helper command in a process of its own; returns what it prints.

    Parameters
    ----------
    words : sequence of str
        A Python module, and its arguments.
    folder : Path
        Working directory.
    about : str
        What messages begin with.
    service, question : str
        Whom is asked, and for what, for messages.
    seconds : float
        Time that it gets.
    too_slow : str
        The message if that is not enough.

    Raises
    ------
    BackendError
        The command refused its input; the error is its own message.
    PeerLostError
        The command crashed, or did not end in time.
    StorageError
        The disk with the temporary files is full.
    """
    try:
        # its temporary folders lie in one of ours, so that they go even if it is killed
        with tempfile.TemporaryDirectory(prefix="gimpmd-probe-") as temporary:
            answer = subprocess.run(
                [sys.executable, "-m", *words],
                cwd=folder,
                env=os.environ | ENVIRONMENT | {"TMPDIR": temporary},
                capture_output=True,
                text=True,
                errors="replace",
                timeout=seconds,
                check=False,
            )
    except subprocess.TimeoutExpired:
        raise PeerLostError(f"{about}{too_slow}") from None
    said = answer.stderr.strip().removeprefix("gimpmd-md: ")
    if answer.returncode == BackendError.exit_code:
        raise BackendError(f"{about}{said}")
    if answer.returncode != 0:
        last = said.splitlines()[-1] if said else "it gave no reason"
        if os.strerror(errno.ENOSPC) in last:
            raise StorageError(f"{about}{last}; make room there, or set TMPDIR to another folder")
        raise PeerLostError(
            f"{about}{service} ended with exit code {answer.returncode} when asked for "
            f"the {question}: {last}"
        )
    return answer.stdout


def decode(answer: str, kind: type[Answer], wrong: str) -> Answer:
    """Read the JSON object that a helper command has printed.

    Parameters
    ----------
    answer : str
    kind : type
        Of the answer.
    wrong : str
        What is said of an answer that is not of this type.

    Raises
    ------
    PeerLostError
        The answer is not of this type.
    """
    try:
        return msgspec.json.decode(answer, type=kind)
    except msgspec.DecodeError as error:
        raise PeerLostError(f"{wrong}: {error}") from None

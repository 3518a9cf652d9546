"""The service that is checked, as a process."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil

from gimpmd_schemas.errors import BackendError

_POLL_SECONDS = 0.02
_LONGEST = 300
"""Characters of what a service says that a report quotes."""


class Process:
    """A started service.

    Parameters
    ----------
    process : the process.
    log : file with its standard output and its standard error.
    """

    def __init__(self, process: subprocess.Popen[bytes], log: Path) -> None:
        self._process, self._log = process, log

    @property
    def code(self) -> int | None:
        """Its exit code; None as long as it runs."""
        return self._process.poll()

    def wait(self, seconds: float) -> bool:
        """Wait for its end; returns whether it has ended."""
        until = time.monotonic() + seconds
        while self.code is None and time.monotonic() < until:
            time.sleep(_POLL_SECONDS)
        return self.code is not None

    def said(self) -> str:
        """What it has written to standard output and standard error."""
        return self._log.read_text(encoding="utf-8", errors="replace")

    def state(self) -> str:
        """Describe whether it runs, or how it ended and what it said last."""
        code = self.code
        if code is None:
            return "the service runs"
        how = f"was killed by {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
        lines = [line.strip() for line in self.said().splitlines() if line.strip()]
        last = lines[-1][-_LONGEST:] if lines else "nothing"
        return f"the end of the service ({how}); it said last: {last}"


@contextmanager
def started(words: Sequence[str], folder: Path, log: Path) -> Iterator[Process]:
    """Start a service in a session of its own; at the end of the block it is killed if it runs.

    Raises
    ------
    BackendError
        The command cannot be started.
    """
    with log.open("ab") as file:
        try:
            process = subprocess.Popen(
                list(words),
                cwd=folder,
                env=os.environ | {"PYTHONUNBUFFERED": "1"},
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=file,
                start_new_session=True,
            )
        except OSError as error:
            raise BackendError(f"{words[0]} cannot be started: {error.strerror}") from None
    try:
        yield Process(process, log)
    finally:
        _kill(process)


def _kill(process: subprocess.Popen[bytes]) -> None:
    """Kill a process that still runs, and its descendants: ``mpiexec`` leaves its ranks behind."""
    if process.poll() is not None:
        return
    family: list[psutil.Process] = []
    with suppress(psutil.NoSuchProcess):
        family = psutil.Process(process.pid).children(recursive=True)
    process.kill()
    process.wait()
    for one in family:
        with suppress(psutil.NoSuchProcess):
            one.kill()

"""Processes of services: how one is started, how it ended, and how all are ended."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import psutil

from gimpmd_schemas.errors import BackendError, PeerLostError

_NOISE = re.compile(r"^=|^YOUR APPLICATION|^This typically|^Please see the FAQ| INFO ")
"""Log lines that are not errors: progress messages, and the banner of mpiexec."""

TICK = 0.05
"""Seconds between two checks of the processes."""

ENVIRONMENT = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONUNBUFFERED": "1"}
"""Set for all services: idle threads of OpenMP and BLAS spin and would slow LAMMPS down."""


@dataclass(frozen=True)
class Service:
    """How to start one service.

    Attributes
    ----------
    argv : its command.
    log : file for its output.
    cwd : its working directory.
    good_codes : exit codes that are no failure.
    """

    name: str
    argv: Sequence[str]
    log: Path
    cwd: Path
    good_codes: tuple[int, ...] = (0,)


@dataclass(frozen=True)
class Child:
    """A started service."""

    service: Service
    process: subprocess.Popen[bytes]

    @property
    def name(self) -> str:
        """Name of the service."""
        return self.service.name

    def running(self) -> bool:
        """Whether it still runs; reaps it if it has ended."""
        return self.process.poll() is None

    def failed(self) -> bool:
        """Whether it has ended with an error."""
        return self.process.poll() not in (None, *self.service.good_codes)

    def state(self) -> str:
        """Return what its process does, such as ``sleeping`` or ``stopped``."""
        try:
            return str(psutil.Process(self.process.pid).status())
        except psutil.NoSuchProcess:
            return "gone"

    def how(self) -> str:
        """Describe how it ended, with the end of its log."""
        code = self.process.returncode
        text = f"was killed by {signal.Signals(-code).name}" if code < 0 else ""
        text = text or f"ended with exit code {code}"
        words = last_words(self.service.log)
        return f"{text}\n{words}" if words else text


def last_words(log: Path, lines: int = 6) -> str:
    """Return the end of a log without progress messages and bodies of tracebacks."""
    try:
        with log.open("rb") as file:
            file.seek(max(0, log.stat().st_size - 16384))
            text = file.read().decode(errors="replace")
    except OSError:
        return ""
    said = text.splitlines()
    tracebacks = [i for i, line in enumerate(said) if line.startswith("Traceback")]
    if tracebacks:
        said = [line for line in said[tracebacks[-1] + 1 :] if not line.startswith(" ")]
    kept = [line.rstrip() for line in said if line.strip() and not _NOISE.search(line)]
    if not kept:
        return ""
    return f"end of {log}:\n" + "\n".join(f"    {line}" for line in kept[-lines:])


def start(service: Service, talks: bool = False, inherits: Sequence[int] = ()) -> Child:
    """Start a service in a session of its own, so that Ctrl-C reaches only the supervisor.

    Parameters
    ----------
    talks : keep its standard input and output as pipes; otherwise its output goes to its log.
    inherits : file descriptors that it keeps open.

    Raises
    ------
    PeerLostError
        The command cannot be started, or its log cannot be written.
    """
    try:
        service.log.parent.mkdir(exist_ok=True)
        with service.log.open("ab") as log:
            process = subprocess.Popen(
                list(service.argv),
                cwd=service.cwd,
                env=os.environ | ENVIRONMENT,
                stdin=subprocess.PIPE if talks else subprocess.DEVNULL,
                stdout=subprocess.PIPE if talks else log,
                stderr=log,
                start_new_session=True,
                pass_fds=inherits,
            )
    except OSError as error:
        reason = error.strerror or str(error)
        raise PeerLostError(f"{service.name} cannot be started: {reason}") from None
    return Child(service, process)


def end_all(children: Sequence[Child], terminate: float, kill: float) -> None:
    """End all processes and their descendants: SIGTERM twice, then SIGKILL.

    The first SIGTERM asks a service to stop the run cleanly, the second one ends it at once.

    Parameters
    ----------
    terminate, kill : float
        Seconds to wait after SIGTERM, and after SIGKILL.
    """
    family: list[psutil.Process] = []
    for child in children:
        if child.running():
            with suppress(psutil.NoSuchProcess):
                family += psutil.Process(child.process.pid).children(recursive=True)
    for number, patience in (
        (signal.SIGTERM, TICK),
        (signal.SIGTERM, terminate),
        (signal.SIGKILL, kill),
    ):
        alive = [child for child in children if child.running()]
        for child in children:
            if child.running() or child.failed():  # its group may outlive a leader that crashed
                with suppress(ProcessLookupError):
                    os.killpg(child.process.pid, number)
        if not alive:
            break
        limit = time.monotonic() + patience
        while any(child.running() for child in alive) and time.monotonic() < limit:
            time.sleep(TICK)
    for process in psutil.wait_procs(family, timeout=0.2)[1]:
        with suppress(psutil.NoSuchProcess):
            process.kill()


def mpiexec() -> str:
    """The ``mpiexec`` of the environment that this Python belongs to.

    Raises
    ------
    BackendError
        There is none.
    """
    path = Path(sys.executable).parent / "mpiexec"
    if not path.exists():
        raise BackendError(f"no mpiexec in {path.parent}: install MPICH there, pip install mpich")
    return str(path)

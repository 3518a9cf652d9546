"""A run that goes on beside a test, and its processes."""

from __future__ import annotations

import re
import subprocess
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import h5py
import psutil

PATIENCE = 120.0
"""Seconds after which a wait for something in a run is given up."""


class Running:
    """A run that has been started.

    Parameters
    ----------
    words : sequence of str
        Command line.
    folder : Path
        Run folder of this command.
    log : Path
        File for what the command prints.
    environment : mapping, optional
    """

    def __init__(
        self,
        words: Sequence[str],
        folder: Path,
        log: Path,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self.folder, self.log = folder, log
        with log.open("w") as file:
            self.process = subprocess.Popen(
                words, stdout=file, stderr=subprocess.STDOUT, env=environment
            )
        self.launcher = psutil.Process(self.process.pid)

    @property
    def output(self) -> str:
        """What the command has printed."""
        return self.log.read_text()

    def wait_for(self, condition: Callable[[], object]) -> None:
        """Wait for something while the command goes on."""
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert self.process.poll() is None, self.output
            assert time.monotonic() < deadline, self.output
            time.sleep(0.01)

    def wait_for_steps(self) -> None:
        """Wait for the first coupling step."""
        self.wait_for(lambda: re.search(r"step [1-9]", self.output))

    def wait_for_end(self, limit: float) -> float:
        """Wait for the end of the command; returns the seconds that this took."""
        start = time.monotonic()
        self.process.wait(timeout=limit + 20.0)
        return time.monotonic() - start

    def processes(self, text: str) -> list[psutil.Process]:
        """Processes with a text in the first four words of their command line.

        They are in the order of their pids, and so of their ranks. In the command line of
        ``mpiexec`` the command of its ranks comes after these words.
        """
        found = []
        for child in self.family():
            try:
                words = child.cmdline()[:4]
            except psutil.NoSuchProcess:
                continue
            if text in " ".join(words):
                found.append(child)
        return sorted(found, key=lambda child: child.pid)

    def family(self) -> list[psutil.Process]:
        """All processes of the run but the command itself; none if that has ended."""
        try:
            return self.launcher.children(recursive=True)
        except psutil.NoSuchProcess:
            return []

    def folder_of_the_bus(self) -> Path:
        """Folder of the socket of the bus, as the log of the coupler names it."""
        text = (self.folder / "logs" / "coupler.log").read_text()
        found = re.search(r"listens on unixsock-stream/(\S+)", text)
        assert found, text
        return Path(found[1]).parent

    def outcome(self) -> str:
        """Outcome in ``run.h5``; empty if there is no such file."""
        try:
            with h5py.File(self.folder / "run.h5") as file:
                return str(file.attrs["outcome"])
        except OSError:
            return ""

    def recorded_steps(self) -> int:
        """Number of steps in ``run.h5``."""
        with h5py.File(self.folder / "run.h5") as file:
            return len(file["series/step"])


def survivors(family: Iterable[psutil.Process], patience: float = 2.0) -> list[int]:
    """Processes that are still at work after a while; the dead may wait to be reaped."""
    deadline = time.monotonic() + patience
    while True:
        left = [one.pid for one in family if works(one)]
        if not left or time.monotonic() > deadline:
            return left
        time.sleep(0.05)


def works(process: psutil.Process) -> bool:
    """Whether a process exists and is no zombie."""
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False

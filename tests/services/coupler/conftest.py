"""A run of the real coupler with small participants, each a process of its own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import msgspec
import pytest

from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import dump_case
from gimpmd_schemas.case.plan import make_plan, write_plan

CASE: dict[str, Any] = {
    "gimpmd": 1,
    "name": "lockstep",
    "units": "lj",
    "domain": {"box": [[0, 120], [0, 80]]},
    "grid": {"cell": 4},
    "time": {"end": 8, "md_timestep": 0.002, "md_steps": 40},
    "md": {"region": [[0, 80], [20, 60]], "input": "md.in", "ranks": 2},
    "coupling": {"scheme": "velocity"},
    "continuum": {"material": {"from": "moduli", "density": 0.93, "lame": 27.8, "shear": 27.8}},
    "output": {"interval": 1},
}
SECONDS = 30.0  # nothing in these tests takes as long


class Child:
    """A process whose lines of JSON are collected with the time at which they came."""

    def __init__(self, *command: str) -> None:
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.lines: list[dict[str, Any]] = []
        self._changed = threading.Condition()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        for line in self.process.stdout:
            with self._changed:
                self.lines.append({**json.loads(line), "at": time.monotonic()})
                self._changed.notify_all()
        with self._changed:
            self._changed.notify_all()

    def find(self, **wanted: Any) -> list[dict[str, Any]]:
        """Lines that hold these values; ``...`` stands for any."""
        return [
            line
            for line in self.lines
            if all(k in line and v in (..., line[k]) for k, v in wanted.items())
        ]

    def wait_for(self, **wanted: Any) -> dict[str, Any]:
        """The first line that holds these values."""
        with self._changed:
            found = self._changed.wait_for(
                lambda: self.find(**wanted) or not self._reader.is_alive(), SECONDS
            )
        assert found, f"nothing came for {SECONDS} s after {self.lines}"
        assert self.find(**wanted), f"no {wanted} among {self.lines}"
        return self.find(**wanted)[0]

    def end(self) -> int:
        """The exit code, once it is there."""
        code = self.process.wait(SECONDS)
        self._reader.join(SECONDS)
        return code

    def kill(self, number: signal.Signals = signal.SIGKILL) -> float:
        """Send a signal; returns when."""
        now = time.monotonic()
        os.kill(self.process.pid, number)
        return now

    def discard(self) -> None:
        """End it, whatever it does."""
        self.process.kill()
        self.process.wait()
        self._reader.join()
        for stream in (self.process.stdin, self.process.stdout, self.process.stderr):
            stream.close()


class Run:
    """A coupler and its participants."""

    def __init__(self, folder: Path, changes: dict[str, Any], options: tuple[str, ...]) -> None:
        self.folder = folder
        plain = deepcopy(CASE)
        for path, value in changes.items():
            *parents, last = path.split("__")
            place = plain
            for parent in parents:
                place = place[parent]
            place[last] = value
        case = msgspec.convert(plain, Case)
        self.plan = make_plan(case)
        dump_case(case, folder / "case.yaml")
        write_plan(self.plan, folder / "plan.yaml")
        command = (sys.executable, "-m", "gimpmd_coupler.service", "--run-dir", str(folder))
        self.coupler = Child(*command, "--run", "test", "--supervised", *options)
        self.children = [self.coupler]
        self.endpoint = self.coupler.wait_for(type="Listening")["endpoint"]

    def join(self, role: str, rank: int = 0, *options: str) -> Child:
        """Start a participant."""
        script = str(Path(__file__).with_name("fake.py"))
        where = ("--run-dir", str(self.folder), "--connect", self.endpoint)
        who = ("--role", role, "--rank", str(rank))
        child = Child(sys.executable, script, *where, *who, *options)
        self.children.append(child)
        return child

    def join_all(self, *options: str, **special: tuple[str, ...]) -> dict[str, Child]:
        """Start all ranks; ``md1=("--pause", "1")`` gives one of them other options."""
        return {
            f"{role}{rank}": self.join(role, rank, *options, *special.get(f"{role}{rank}", ()))
            for role in self.plan.roles
            for rank in range(self.plan.ranks(role))
        }


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., Run]]:
    """Start a coupler: ``start("--deadline", "1", md__ranks=3)``."""
    runs: list[Run] = []

    def begin(*options: str, **changes: Any) -> Run:
        runs.append(Run(tmp_path, changes, options))
        return runs[-1]

    yield begin
    for run in runs:
        for child in run.children:
            child.discard()

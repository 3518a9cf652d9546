"""Intruders on another host: a run goes on as if they were not there."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from gimpmd_deploy.launch.keys import new_keys
from gimpmd_deploy.results.run import Run
from tests.cluster.conftest import Cluster
from tests.cluster.intruder import MANNERS
from tests.cluster.small_run import GIMPMD, check_same_bits, write
from tests.conftest import ROOT
from tests.ports import free_port

pytestmark = [pytest.mark.cluster, pytest.mark.timeout(300)]

ADDRESS = "10.77.0.1"
"""Address of this host in the cluster."""


class Started:
    """A run whose services were started by hand on this host, open to the others by TLS."""

    def __init__(self, folder: Path) -> None:
        place = f"{ADDRESS}:{free_port(ADDRESS)}"
        self.out, self.endpoint = folder / "run", f"tls/{place}"
        words = [GIMPMD, "prepare", str(write(folder, 2.0)), "--out", str(self.out)]
        text = subprocess.run(
            [*words, "--listen", place], capture_output=True, text=True, check=True
        ).stdout
        _, *commands = (line for line in text.splitlines() if not line.startswith("#"))
        self.id = commands[0].split()[commands[0].split().index("--run") + 1]
        path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
        self.log = folder / "output.txt"
        with self.log.open("w") as log:
            self.services = [
                subprocess.Popen(
                    f"exec {command}",
                    shell=True,
                    env=os.environ | {"PATH": path, "OMP_NUM_THREADS": "1"},
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                )
                for command in commands
            ]

    def wait_for_step(self) -> None:
        while '"Progress"' not in self.log.read_text():
            assert all(service.poll() is None for service in self.services), self.log.read_text()

    def finished(self) -> Run:
        for service in self.services:
            assert service.wait(200.0) == 0, self.log.read_text()
        return Run(self.out)


@pytest.fixture
def intrude(cluster: Cluster, tmp_path: Path) -> Callable[[Started, str], str]:
    """Let an intruder begin on the host n1; returns what he says about it."""
    begun: list[subprocess.Popen[str]] = []

    def begin(run: Started, manner: str) -> str:
        keys = run.out / "keys"
        if MANNERS[manner][1] == "another":
            keys = tmp_path / "another"
            new_keys(keys, [ADDRESS])
        program = [sys.executable, "-m", "tests.cluster.intruder", manner, run.endpoint]
        child = subprocess.Popen(
            ["nsenter", "--net=/run/netns/gimpmd-h2", *program, run.id, str(keys)],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            text=True,
        )
        begun.append(child)
        assert child.stdout is not None
        return child.stdout.readline().strip()

    yield begin
    for child in begun:
        child.send_signal(signal.SIGKILL)
        child.wait()


@pytest.mark.parametrize("manner", MANNERS)
def test_the_bits_stay_the_same(
    tmp_path: Path, local: Run, manner: str, intrude: Callable[[Started, str], str]
) -> None:
    run = Started(tmp_path)
    run.wait_for_step()
    found = intrude(run, manner)
    assert found == ("at work" if MANNERS[manner][1] == "mine" else "refused")
    check_same_bits(run.finished(), local)

"""A Slurm cluster of two hosts inside this machine."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from gimpmd_deploy.results.run import Run
from gimpmd_schemas.on_disk import write_at_once
from tests.small_run import run_here, write

HERE = Path(__file__).parent
NEEDED = ("slurmctld", "slurmd", "sbatch", "munged", "ip", "nsenter")


class Cluster:
    """The cluster, and its two hosts ``n1`` and ``n2``."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.environment = os.environ | {
            "LAB": str(folder),
            "PYTHON": sys.executable,
            "SLURM_CONF": str(folder / "slurm.conf"),
        }

    def call(self, *words: str, timeout: float = 60.0) -> str:
        """Run a command, and return its output."""
        done = subprocess.run(
            words,
            env=self.environment,
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def state(self, job: str) -> tuple[str, str]:
        """State and exit code of a job, such as ``("COMPLETED", "0:0")``."""
        text = self.call("scontrol", "show", "job", job)
        words = dict(word.split("=", 1) for word in text.split() if "=" in word)
        return words["JobState"], words["ExitCode"]

    def wait_for_end(self, job: str, seconds: float) -> tuple[str, str]:
        """State and exit code of a job after its end."""
        deadline = time.monotonic() + seconds
        while (now := self.state(job))[0] in ("PENDING", "RUNNING", "CONFIGURING", "COMPLETING"):
            assert time.monotonic() < deadline, now
            time.sleep(0.5)
        return now

    def set_network(self, delay: float, loss: float = 0.0) -> None:
        """Let every frame from and to a host wait, in seconds, and lose a share of them."""
        for i in ("2", "3"):
            # it is read all the time
            write_at_once(self.folder / f"link{i}", f"{delay} {loss}".encode())


@pytest.fixture(scope="session")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """The cluster, for all tests of a session."""
    missing = [name for name in NEEDED if shutil.which(name) is None]
    if os.geteuid() != 0 or missing:
        pytest.fail(f"needs root, and these commands: {', '.join(missing) or 'all are there'}")
    made = Cluster(tmp_path_factory.mktemp("cluster"))
    try:
        made.call(str(HERE / "up"))
        yield made
    finally:
        made.call(str(HERE / "down"))


@pytest.fixture(scope="session")
def local(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The run on one host."""
    folder = tmp_path_factory.mktemp("local")
    return run_here(write(folder, 2.0), folder / "run")

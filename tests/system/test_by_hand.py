"""Services that are started by hand, as ``gimpmd prepare`` says."""

from __future__ import annotations

import os
import shlex
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from gimpmd_deploy.results.run import Run
from tests.system.test_runs import by_site

PATH = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
SECONDS = 120.0


def free_port() -> int:
    """A port that nobody uses."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def start_all(text: str) -> None:
    """Start the commands in a shell, ranks first, and wait for their end."""
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    setting, coupler, *ranks = lines
    script = "\n".join([setting, *(f"{line} &" for line in ranks), "sleep 1", coupler, "wait"])
    done = subprocess.run(
        ["/bin/sh", "-euc", script],
        env=os.environ | {"PATH": PATH},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=SECONDS,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert '"type":"Ended"' in done.stdout


@pytest.mark.parametrize("tls", [True, pytest.param(False, marks=pytest.mark.long)])
def test_the_bits_are_those_of_gimpmd_run(command, case, coupled, tls: bool) -> None:
    case["time"]["end"] = 1.0
    out = command.folder / "prepared"
    words = ["prepare", str(command.write(case)), "--out", str(out)]
    words += ["--listen", f"localhost:{free_port()}"] if tls else []
    done = subprocess.run(
        command.arguments(*words), capture_output=True, text=True, timeout=SECONDS, check=True
    )
    assert "password" not in done.stdout
    for secret in (out / "keys").glob("*.password"):
        assert secret.read_text().strip() not in done.stdout
    assert shlex.quote(str(out)) in done.stdout
    start_all(done.stdout)
    run = Run(out)
    assert run.outcome == "completed"
    for one, other in zip(by_site(coupled, 1.0), by_site(run, 1.0), strict=True):
        assert (one == other).all()
    assert (coupled.points(1.0).position == run.points(1.0).position).all()

"""The commands ``gimpmd-md probe`` and ``gimpmd-md serve``, as processes."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
import pytest

from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import dump_case
from gimpmd_schemas.case.plan import make_plan, write_plan
from gimpmd_schemas.checkpoint.manifest import committed
from tests.mpi import MPIEXEC

SERVICE = [sys.executable, "-m", "gimpmd_md.service"]
EXAMPLE = Path(__file__).parents[3] / "examples" / "mode1-small"
ALONE: dict[str, Any] = {
    "only": "md",
    "domain__box": [[0, 26], [0, 26]],
    "md__region": [[0, 26], [0, 26]],
    "md__ranks": 2,
}


@dataclass
class Run:
    """A coupler and the MD service of two ranks, in a run folder."""

    folder: Path
    coupler: subprocess.Popen[str]
    md: subprocess.Popen[str]

    def end(self) -> tuple[int, str, list[dict[str, Any]]]:
        """Exit code and errors of the MD service, and the coupler's events."""
        _, errors = self.md.communicate(timeout=60)
        events, _ = self.coupler.communicate(timeout=60)
        return self.md.returncode, errors, [json.loads(line) for line in events.splitlines()]


@pytest.fixture
def serve(folder: Path) -> Iterator[Callable[[Case], Run]]:
    """Start a coupler and the service on a case; what still runs afterwards is ended."""
    runs: list[Run] = []

    def _serve(case: Case) -> Run:
        run_dir = folder / "a run"  # LAMMPS does not like spaces; a user's folder may have them
        for name in ("input", "logs"):
            (run_dir / name).mkdir(parents=True)
        for script in folder.glob("*.in"):
            shutil.copy(script, run_dir / "input")
        dump_case(case, run_dir / "case.yaml")
        write_plan(make_plan(case), run_dir / "plan.yaml")
        where = ["--run-dir", str(run_dir), "--run", "test"]
        pipe = subprocess.PIPE
        coupler = subprocess.Popen(
            [sys.executable, "-m", "gimpmd_coupler.service", *where],
            stdin=pipe,
            stdout=pipe,
            text=True,
        )
        assert coupler.stdout is not None
        endpoint = json.loads(coupler.stdout.readline())["endpoint"]
        command = [MPIEXEC, "-n", str(case.md.ranks), *SERVICE, "serve", *where]
        md = subprocess.Popen([*command, "--connect", endpoint], stderr=pipe, text=True)
        runs.append(Run(run_dir, coupler, md))
        return runs[-1]

    yield _serve
    for run in runs:
        for process in (run.md, run.coupler):
            if process.poll() is None:
                process.kill()
                process.wait()


# --- serve ---------------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", [pytest.param("velocity", marks=pytest.mark.long), "force"])
def test_serve_runs_to_the_end(
    serve: Callable[[Case], Run], make: Callable[..., Case], scheme: str
) -> None:
    case = make(**ALONE, time__end=0.4, output__interval=0.2, coupling__scheme=scheme)
    run = serve(case)
    code, errors, events = run.end()
    assert code == 0, errors
    assert events[-1]["type"] == "Ended"
    assert events[-1]["step"] == 10
    dump = (run.folder / "atoms" / "atoms.dump").read_text()
    assert dump.count("ITEM: TIMESTEP") == 3
    assert (run.folder / "logs" / "log.lammps").is_file()
    assert "stopped at step 10" in (run.folder / "logs" / "md.log").read_text()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        pytest.param("pair_style lj/cut", "pair_style lj/cat", "lj/cat", marks=pytest.mark.long),
        ("mass 1 ${mass}", "include none.in", "none.in"),
    ],
)
def test_serve_reports_a_bad_script(
    serve: Callable[[Case], Run],
    make: Callable[..., Case],
    folder: Path,
    old: str,
    new: str,
    words: str,
) -> None:
    text = (folder / "block.in").read_text().replace(old, new)
    (folder / "block.in").write_text(text)
    code, errors, events = serve(make(**ALONE)).end()
    assert code == 2
    assert words in errors
    failures = [event for event in events if event["type"] == "ServiceFailed"]
    assert failures
    assert failures[0]["exit_code"] == 2
    assert words in failures[0]["message"]


def wait_for_acceptance(run: Run) -> None:
    """Until the ranks take steps."""
    log, deadline = run.folder / "logs" / "md.log", time.monotonic() + 60.0
    while "accepted for steps" not in (log.read_text() if log.exists() else ""):
        assert time.monotonic() < deadline, "the ranks have not been accepted"
        time.sleep(0.05)


def test_sigterm_stops_the_run_with_a_checkpoint(
    serve: Callable[[Case], Run], make: Callable[..., Case]
) -> None:
    """To a rank, as batch systems send it to all tasks."""
    run = serve(make(**ALONE, time__end=4000.0))
    wait_for_acceptance(run)
    rank = psutil.Process(run.md.pid).children(recursive=True)[-1]
    rank.send_signal(signal.SIGTERM)
    start = time.monotonic()
    code, errors, events = run.end()
    assert code == 0, errors
    assert time.monotonic() - start < 10.0
    (ended,) = (event for event in events if event["type"] == "Ended")
    assert ended["stopped"]
    assert [one.step for one in committed(run.folder)] == [ended["step"]]


def test_a_killed_rank_takes_the_others_along(
    serve: Callable[[Case], Run], make: Callable[..., Case]
) -> None:
    import psutil

    run = serve(make(**ALONE, time__end=4000.0))
    wait_for_acceptance(run)
    ranks = [
        child
        for child in psutil.Process(run.md.pid).children(recursive=True)
        if "gimpmd_md.service" in child.cmdline()
    ]
    assert len(ranks) == 2
    os.kill(ranks[1].pid, signal.SIGKILL)
    start = time.monotonic()
    code, _, events = run.end()
    assert code != 0
    assert time.monotonic() - start < 20.0
    assert any(event["type"] in ("Lost", "ServiceFailed") for event in events)

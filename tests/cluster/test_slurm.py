"""``gimpmd slurm`` on a real Slurm with two hosts: same bits as a local run, and a clean stop."""

from __future__ import annotations

import re
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gimpmd_deploy.results.run import Run
from gimpmd_schemas.checkpoint.manifest import committed
from tests.cluster.conftest import Cluster
from tests.small_run import GIMPMD, PROGRAMS, check_same_bits, run_here, write

pytestmark = [pytest.mark.cluster, pytest.mark.timeout(600)]

NODES = ("--option", "nodes=2", "--option", "ntasks-per-node=2")


def submitted(
    cluster: Cluster, folder: Path, end: float, *options: str, **more: Any
) -> tuple[str, Path]:
    """Id of a job of the small case with more keys, and its run folder."""
    out = folder / "run"
    case = write(folder, end, **more)
    words = (GIMPMD, "slurm", str(case), "--out", str(out), "--submit", *options)
    job = re.search(r"job (\d+) runs", cluster.call(*words))
    assert job is not None
    return job[1], out


def log_of(out: Path) -> str:
    """All logs, for a test that fails."""
    return "\n".join(path.read_text() for path in sorted((out / "logs").glob("*.log")))


@pytest.mark.parametrize(
    ("delay", "loss"), [(0.0, 0.0), (0.005, 0.0), (0.05, 0.0), (0.005, 0.01), (0.05, 0.01)]
)
def test_two_hosts_give_the_bits_of_one(
    cluster: Cluster, tmp_path: Path, local: Run, delay: float, loss: float
) -> None:
    """The delay is that of one way between the hosts; a frame crosses the links of both."""
    cluster.set_network(0.5 * delay, 0.5 * loss)
    try:
        job, out = submitted(cluster, tmp_path, 2.0, *NODES)
        assert cluster.wait_for_end(job, 240.0) == ("COMPLETED", "0:0"), log_of(out)
    finally:
        cluster.set_network(0.0)
    run = Run(out)
    check_same_bits(run, local)
    phases = np.sum(list(run.timings.phases["md"].values()), axis=0)
    print(f"{1e3 * delay:g} ms, {loss:.0%} lost: {1e3 * np.median(phases):.1f} ms a step")


def test_a_job_goes_on_after_its_time_limit(cluster: Cluster, tmp_path: Path) -> None:
    """It stops before the limit with a checkpoint, and is queued again."""
    job, out = submitted(cluster, tmp_path, 1000.0, *NODES, "--time", "1", "--notice", "25")
    deadline = time.monotonic() + 400.0
    log = out / "logs/coupler.log"
    while "goes on" not in (text := log.read_text() if log.exists() else ""):
        assert time.monotonic() < deadline, log_of(out)
        assert cluster.state(job)[0] in ("PENDING", "RUNNING", "COMPLETING"), log_of(out)
        time.sleep(1.0)
    cluster.call("scancel", job)
    (stopped,) = re.findall(r"checkpoint of step (\d+)", text)
    assert f"the run goes on at step {stopped}" in text
    assert int(stopped) > 10


@pytest.mark.parametrize(("seconds", "survives"), [(3.0, True), (40.0, False)])
def test_a_network_that_is_cut(
    cluster: Cluster, tmp_path: Path, seconds: float, survives: bool
) -> None:
    """The run goes on after a short cut. A long one ends it, and it is resumed: same bits."""
    end, times = 8.0, (0.0, 4.0, 8.0)
    job, out = submitted(cluster, tmp_path, end, *NODES, checkpoint={"steps": 10})
    deadline = time.monotonic() + 120.0
    while not (out.exists() and committed(out)):
        assert time.monotonic() < deadline, log_of(out)
        time.sleep(0.1)
    cluster.set_network(0.0, 1.0)
    try:
        time.sleep(seconds)
    finally:
        cluster.set_network(0.0)
    state = cluster.wait_for_end(job, 240.0)
    if survives:
        assert state == ("COMPLETED", "0:0"), log_of(out)
    else:
        assert state == ("FAILED", "3:0"), log_of(out)
        assert re.search(r"(md|continuum)/\d was lost", log_of(out))
        subprocess.run([GIMPMD, "resume", out, "--no-figures"], check=True, capture_output=True)
    check_same_bits(Run(out), run_here(tmp_path / "case.yaml", tmp_path / "here"), times)


def test_a_rank_that_dies_ends_the_job_and_is_named(cluster: Cluster, tmp_path: Path) -> None:
    job, out = submitted(cluster, tmp_path, 1000.0, *NODES)
    log = out / "logs" / f"slurm-{job}.log"
    while not (log.exists() and '"Progress"' in log.read_text()):
        assert cluster.state(job)[0] in ("PENDING", "RUNNING"), log_of(out)
    subprocess.run(["pkill", "-KILL", "-f", f"gimpmd-gimp.*{out}"], check=True)
    state, code = cluster.wait_for_end(job, 60.0)
    assert (state, code) == ("FAILED", "3:0"), log_of(out)
    assert "continuum/0" in (out / "logs" / "coupler.log").read_text()


WITHOUT_RANK_1 = """\
#!/bin/bash
[ "$SLURM_PROCID" = 1 ] && exit 7
exec {program} "$@"
"""


def test_a_rank_that_ends_before_mpi_has_started_ends_the_job(
    cluster: Cluster, tmp_path: Path
) -> None:
    """The other rank of its side waits for it in MPI, and has told the coupler nothing yet."""
    out = tmp_path / "run"
    cluster.call(GIMPMD, "slurm", str(write(tmp_path, 2.0)), "--out", str(out), *NODES)
    script, wrapper = out / "job.sh", tmp_path / "without-rank-1"
    program = str(PROGRAMS / "gimpmd-md")
    wrapper.write_text(WITHOUT_RANK_1.format(program=program))
    wrapper.chmod(0o755)
    script.write_text(script.read_text().replace(f"{program} serve", f"{wrapper} serve"))
    job = cluster.call("sbatch", "--parsable", str(script)).strip()
    state, _ = cluster.wait_for_end(job, 150.0)
    assert state == "FAILED", log_of(out)
    assert "task 1: Exited with exit code 7" in log_of(out)


def test_a_side_that_cannot_start_ends_the_job(cluster: Cluster, tmp_path: Path) -> None:
    out = tmp_path / "run"
    cluster.call(GIMPMD, "slurm", str(write(tmp_path, 2.0)), "--out", str(out), *NODES)
    script = out / "job.sh"
    script.write_text(script.read_text().replace("gimpmd-md serve", "gimpmd-md swerve"))
    job = cluster.call("sbatch", "--parsable", str(script)).strip()
    assert cluster.wait_for_end(job, 60.0) == ("FAILED", "2:0"), log_of(out)
    assert "invalid choice: 'swerve'" in log_of(out)

"""Intruders on another host: a run goes on as if they were not there."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest

from gimpmd_deploy.launch.keys import new_keys
from gimpmd_deploy.results.run import Run
from tests.cluster.conftest import Cluster
from tests.cluster.intruder import MANNERS
from tests.conftest import ROOT
from tests.ports import free_port
from tests.small_run import SECONDS, ByHand, check_same_bits, write

pytestmark = [pytest.mark.cluster, pytest.mark.timeout(300)]

ADDRESS = "10.77.0.1"
"""Address of this host in the cluster."""


PERIODS, PERIOD = 16, 2.0
"""Periods with an intruder, and their length, seconds."""
MOST = 1.10
"""Time of a step with an intruder, in that without."""
BESIDE_THE_COUPLER = ("chrt", "--idle", "0", "taskset", "--cpu-list", "1")


class Intruder:
    """An intruder on the host n1; ``first`` is what he says about his way in."""

    def __init__(self, run: ByHand, manner: str, keys: Path, *prefix: str) -> None:
        place = re.search(r"--listen (\S+)", run.text)
        assert place is not None
        enter = [*prefix, "nsenter", "--net=/run/netns/gimpmd-h2"]
        program = [sys.executable, "-m", "tests.cluster.intruder", manner, place[1]]
        self._process = subprocess.Popen(
            [*enter, *program, run.id, str(keys)],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._process.stdout is not None
        self.first = self._process.stdout.readline().strip()

    def end(self) -> None:
        """End it, whatever it does."""
        self._process.kill()
        self._process.wait()


@pytest.fixture
def intrude(cluster: Cluster, tmp_path: Path) -> Iterator[Callable[[ByHand, str], Intruder]]:
    """Let an intruder begin."""
    begun: list[Intruder] = []

    def begin(run: ByHand, manner: str, *prefix: str) -> Intruder:
        keys = run.out / "keys"
        if MANNERS[manner][1] == "another":
            keys = tmp_path / "another"
            new_keys(keys, [ADDRESS])
        begun.append(Intruder(run, manner, keys, *prefix))
        return begun[-1]

    yield begin
    for one in begun:
        one.end()


def prepared(folder: Path, end: float) -> ByHand:
    """A run on this host that is open to the others by TLS."""
    place = f"{ADDRESS}:{free_port(ADDRESS)}"
    return ByHand(write(folder, end), folder / "run", "--listen", place)


@pytest.mark.parametrize("manner", MANNERS)
def test_the_bits_stay_the_same(
    tmp_path: Path, local: Run, manner: str, intrude: Callable[[ByHand, str], Intruder]
) -> None:
    _, keys, said = MANNERS[manner]
    with prepared(tmp_path, 2.0) as run:
        run.wait_for_step()
        assert intrude(run, manner).first == ("at work" if keys == "mine" else "refused")
        check_same_bits(run.finished(), local)
    assert said in (run.out / "logs" / "coupler.log").read_text()


@pytest.mark.parametrize("manner", ["forge", "never read", "replay", "take tokens"])
def test_the_time_stays_the_same(
    tmp_path: Path, manner: str, intrude: Callable[[ByHand, str], Intruder]
) -> None:
    """One run, with an intruder in every other period.

    Each period with an intruder is compared with the mean of the two beside it, so what changes
    slowly has no effect; medians count. Run this on a machine that does nothing else.

    The ranks have one core. The coupler has the other one, on which the intruder runs only while
    the coupler does not: an intruder on another host takes no core from the run.
    """
    used: list[tuple[float, float]] = []
    with prepared(tmp_path, 1000.0) as run:
        run.wait_for_step()
        for service, core in zip(run.services, (0, 0, 1), strict=True):
            pin(service.pid, core)
        for period in range(2 * PERIODS + 1):
            busy = period % 2 == 1
            child = intrude(run, manner, *BESIDE_THE_COUPLER) if busy else None
            assert child is None or child.first == "at work"
            before = moment(run)
            time.sleep(PERIOD)
            after = moment(run)
            if child is not None:
                child.end()
            steps, wall, processor = (b - a for a, b in zip(before, after, strict=True))
            used.append((1e3 * wall / steps, processor / wall))
        coupler = run.services[-1]
        coupler.terminate()
        assert coupler.wait(SECONDS) == 5, run.log  # stopped before its end
    all_periods = np.array(used)
    quiet, disturbed = all_periods[::2], all_periods[1::2]
    ratios = disturbed / (quiet[:-1] + quiet[1:]) * 2.0
    for name, one, ratio in zip(
        ("ms a step", "cores for the coupler"), quiet.T, ratios.T, strict=True
    ):
        low, median, high = np.quantile(ratio, (0.25, 0.5, 0.75))
        print(f"{manner}: {np.median(one):.3f} {name}, times {median:.3f} ({low:.3f}, {high:.3f})")
    assert np.median(ratios[:, 0]) < MOST


def pin(pid: int, core: int) -> None:
    """Give all threads of a process and of its children one core."""
    process = psutil.Process(pid)
    for one in (process, *process.children(recursive=True)):
        words = ["taskset", "--all-tasks", "--cpu-list", "--pid", str(core), str(one.pid)]
        subprocess.run(words, check=True, capture_output=True)


def moment(run: ByHand) -> tuple[float, float, float]:
    """The next step of which the coupler tells, its time, and processor time of the coupler."""
    count = run.log.count('"Progress"')
    while run.log.count('"Progress"') == count:
        assert all(service.poll() is None for service in run.services), run.log
        time.sleep(0.002)
    now, times = time.monotonic(), psutil.Process(run.services[-1].pid).cpu_times()
    step = re.findall(r'"Progress","step":(\d+)', run.log)[-1]
    return float(step), now, times.user + times.system

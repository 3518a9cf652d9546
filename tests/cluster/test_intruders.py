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
from tests.small_run import ByHand, check_same_bits, write

pytestmark = [pytest.mark.cluster, pytest.mark.timeout(300)]

ADDRESS = "10.77.0.1"
"""Address of this host in the cluster."""


PAIRS, PERIOD = 6, 4.0
"""Periods with an intruder, and their length, seconds."""
MOST = 0.10
"""What an intruder may add to the processor time of a step, and to the use of a core."""


class Intruder:
    """An intruder on the host n1; ``first`` is what he says about his way in."""

    def __init__(self, run: ByHand, manner: str, keys: Path) -> None:
        place = re.search(r"--listen (\S+)", run.text)
        assert place is not None
        program = [sys.executable, "-m", "tests.cluster.intruder", manner, place[1]]
        self._process = subprocess.Popen(
            ["nsenter", "--net=/run/netns/gimpmd-h2", *program, run.id, str(keys)],
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

    def begin(run: ByHand, manner: str) -> Intruder:
        keys = run.out / "keys"
        if MANNERS[manner][1] == "another":
            keys = tmp_path / "another"
            new_keys(keys, [ADDRESS])
        begun.append(Intruder(run, manner, keys))
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

    The wall time of a step is shown, but other work on the machine changes it. So two other things
    are tested: the processor time of the ranks in a step, and which part of its core the coupler
    uses. The first and the last period have no intruder, so what changes slowly has no effect.
    """
    times: dict[bool, list[tuple[float, float, float]]] = {False: [], True: []}
    with prepared(tmp_path, 1000.0) as run:
        run.wait_for_step()
        for period in range(2 * PAIRS + 1):
            busy = period % 2 == 1
            child = intrude(run, manner) if busy else None
            before = moment(run)
            time.sleep(PERIOD)
            after = moment(run)
            if child is not None:
                child.end()
            steps, wall, ranks, coupler = (b - a for a, b in zip(before, after, strict=True))
            times[busy].append((1e3 * wall / steps, 1e3 * ranks / steps, coupler / wall))
        run.services[-1].terminate()  # the coupler
        run.finished()
    quiet, disturbed = (np.median(times[busy], axis=0) for busy in (False, True))
    names = ("ms a step", "ms of processor time of the ranks a step", "of a core by the coupler")
    for name, one, other in zip(names, quiet, disturbed, strict=True):
        print(f"{manner}: {one:.3f} {name}, disturbed {other:.3f}, ratio {other / one:.3f}")
    assert disturbed[1] < (1.0 + MOST) * quiet[1]
    assert disturbed[2] < MOST + quiet[2]


def moment(run: ByHand) -> tuple[float, float, float, float]:
    """The next step of which the coupler tells, its time, processor time of ranks and coupler."""
    count = run.log.count('"Progress"')
    while run.log.count('"Progress"') == count:
        assert all(service.poll() is None for service in run.services), run.log
        time.sleep(0.002)
    now = time.monotonic()
    *ranks, coupler = (processor_time(service.pid) for service in run.services)
    step = re.findall(r'"Progress","step":(\d+)', run.log)[-1]
    return float(step), now, sum(ranks), coupler


def processor_time(pid: int) -> float:
    """Of a process and its descendants, seconds."""
    parent = psutil.Process(pid)
    used = [one.cpu_times() for one in (parent, *parent.children(recursive=True))]
    return sum(times.user + times.system for times in used)

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


PAIRS, PERIOD = 8, 2.0
"""Periods with an intruder, and their length, seconds."""
MOST = 1.10
"""Time of a step with an intruder, in that without."""


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

    The first and the last period have no intruder, so what changes slowly has no effect. Medians
    of the periods are compared. Run this on a machine that does nothing else.
    """
    used: dict[bool, list[tuple[float, float]]] = {False: [], True: []}
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
            steps, wall, coupler = (b - a for a, b in zip(before, after, strict=True))
            used[busy].append((1e3 * wall / steps, coupler / wall))
        run.services[-1].terminate()  # the coupler
        run.finished()
    quiet, disturbed = (np.median(used[busy], axis=0) for busy in (False, True))
    for name, one, other in zip(
        ("ms a step", "cores for the coupler"), quiet, disturbed, strict=True
    ):
        print(f"{manner}: {one:.3f} {name}, disturbed {other:.3f}, ratio {other / one:.3f}")
    assert disturbed[0] < MOST * quiet[0]


def moment(run: ByHand) -> tuple[float, float, float]:
    """The next step of which the coupler tells, its time, and processor time of the coupler."""
    count = run.log.count('"Progress"')
    while run.log.count('"Progress"') == count:
        assert all(service.poll() is None for service in run.services), run.log
        time.sleep(0.002)
    now, times = time.monotonic(), psutil.Process(run.services[-1].pid).cpu_times()
    step = re.findall(r'"Progress","step":(\d+)', run.log)[-1]
    return float(step), now, times.user + times.system

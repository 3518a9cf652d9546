"""Processes that die or fall silent: who is named, how fast, and that nobody hangs."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py
import psutil
import pytest

pytestmark = pytest.mark.timeout(90)
Start = Callable[..., Any]


def running(run: Any, *options: str, **special: tuple[str, ...]) -> dict[str, Any]:
    """All ranks, some steps into the run."""
    children = run.join_all("--pause", "0.005", *options, **special)
    run.coupler.wait_for(type="Progress", step=0)
    time.sleep(0.5)
    return children


def command(run: Any, words: str) -> None:
    """Give a command to the coupler, as the process that started it does."""
    os.write(run.coupler.process.stdin.fileno(), words.encode() + b"\n")


@pytest.mark.parametrize(
    "victim", [pytest.param("md0", marks=pytest.mark.long), "md1", "continuum0"]
)
def test_a_killed_rank_is_named_at_once(start: Start, victim: str) -> None:
    run = start(time__end=8000)
    children = running(run)
    killed = children[victim].kill()
    lost = run.coupler.wait_for(type="Lost")
    who = f"{victim[:-1]}/{victim[-1]}"
    assert lost["who"] == who
    assert "is gone" in lost["reason"]
    assert lost["at"] - killed < 1.0
    assert run.coupler.end() == 3
    for name, child in children.items():
        if name != victim:
            assert child.end() == 3
            error = child.wait_for(error="PeerLostError")
            assert f"{who} was lost" in error["message"]
            assert error["at"] - killed < 1.0
    with h5py.File(run.folder / "run.h5") as file:
        assert who in file.attrs["outcome"]
        assert len(file["series/step"]) > 5


def test_a_killed_coupler_ends_all_within_three_seconds(start: Start) -> None:
    run = start(time__end=8000)
    children = running(run)
    killed = run.coupler.kill()
    for child in children.values():
        assert child.end() == 3
        error = child.wait_for(error="PeerLostError")
        assert "coupler" in error["message"]
        assert error["at"] - killed < 3.0
    assert time.monotonic() - killed < 4.0


def test_the_first_to_die_is_the_culprit(start: Start) -> None:
    """When a rank dies MPI kills the others of its service later.

    The bus does not keep the order of two ends that are a few milliseconds apart.
    """
    run = start(time__end=8000)
    children = running(run)
    children["md1"].kill()
    time.sleep(0.1)
    children["md0"].kill()
    assert run.coupler.wait_for(type="Lost")["who"] == "md/1"
    assert children["continuum0"].end() == 3
    assert "md/1 was lost" in children["continuum0"].wait_for(error=...)["message"]


def test_a_frozen_rank_is_named(start: Start) -> None:
    run = start(time__end=8000)
    children = running(run)
    frozen = children["continuum0"].kill(signal.SIGSTOP)
    lost = run.coupler.wait_for(type="Lost")
    assert lost["who"] == "continuum/0"
    assert "stopped" in lost["reason"]
    assert lost["at"] - frozen < 8.0
    assert {children[who].end() for who in ("md0", "md1")} == {3}


def test_a_rank_frozen_for_a_moment_goes_on(start: Start) -> None:
    run = start(time__end=16)
    children = running(run)
    children["md0"].kill(signal.SIGSTOP)
    time.sleep(1.0)
    children["md0"].kill(signal.SIGCONT)
    assert run.coupler.end() == 0
    assert {child.end() for child in children.values()} == {0}


def test_a_silent_rank_is_waited_for_named_and_given_up(start: Start) -> None:
    run = start("--deadline", "0.1", time__end=8000)
    children = running(run, md1=("--sleep-at", "20"))
    waiting = run.coupler.wait_for(type="Waiting", who=["md/1"])
    lost = run.coupler.wait_for(type="Lost")
    assert lost["who"] == "md/1"
    assert "silent for" in lost["reason"]
    assert 0.5 < lost["at"] - waiting["at"] < 2.0
    assert {children[who].end() for who in ("md0", "continuum0")} == {3}
    for who in ("md0", "continuum0"):
        assert "md/1 was lost at step 20: silent" in children[who].wait_for(error=...)["message"]
    children["md1"].kill()
    assert run.coupler.end() == 3
    log = (run.folder / "logs" / "coupler.log").read_text()
    assert "waiting for md/1" in log


def test_a_rank_that_never_comes_is_named(start: Start) -> None:
    run = start("--deadline", "0.1")
    present = [run.join("md", 0), run.join("md", 1)]
    lost = run.coupler.wait_for(type="Lost")
    assert lost["who"] == "continuum/0"
    assert "has not registered" in lost["reason"]
    assert {child.end() for child in present} == {3}
    assert run.coupler.end() == 3


def test_without_a_coupler_a_service_says_so(start: Start) -> None:
    run = start()
    run.coupler.kill()
    run.coupler.end()
    child = run.join("md")
    assert child.end() == 3
    assert "no coupler at unixsock-stream/" in child.wait_for(error="PeerLostError")["message"]


def test_only_the_user_can_connect(start: Start) -> None:
    """The coupler listens on no port, but on a socket in a folder of its own, which it removes."""
    run = start()
    process = psutil.Process(run.coupler.process.pid)
    assert process.net_connections("inet") == []
    socket = Path(run.endpoint.removeprefix("unixsock-stream/"))
    assert socket.is_socket()
    assert socket.parent.stat().st_mode & 0o777 == 0o700
    run.coupler.process.stdin.close()
    run.coupler.kill(signal.SIGTERM)
    run.coupler.discard()


def test_a_service_that_dies_before_it_registers_is_named(start: Start) -> None:
    """Only the process that started it can know; it says so on standard input."""
    run = start()
    child = run.join("continuum")
    run.coupler.wait_for(type="Registered", who="continuum/0")
    command(run, "lost md it was killed by SIGKILL")
    lost = run.coupler.wait_for(type="Lost")
    assert (lost["who"], lost["reason"]) == ("md", "it was killed by SIGKILL")
    assert run.coupler.end() == 3
    assert child.end() == 3
    with h5py.File(run.folder / "run.h5") as file:
        assert file.attrs["outcome"] == "failed: md was lost at step 0: it was killed by SIGKILL"


def test_a_rank_that_the_coupler_knows_is_named_with_its_number(start: Start) -> None:
    run = start(time__end=8000)
    children = running(run)
    children["md1"].kill()
    command(run, "lost md it was killed by SIGKILL")
    assert run.coupler.wait_for(type="Lost")["who"] == "md/1"


def test_a_service_that_ends_when_the_run_does_is_not_lost(start: Start) -> None:
    """Word of its end arrives while the coupler waits for the other ranks to leave."""
    run = start(time__end=8)
    children = run.join_all()
    run.coupler.wait_for(type="Progress", step=run.plan.steps)
    with suppress(BrokenPipeError):  # the coupler may have left already
        command(run, "lost md it ended with exit code 0")
    assert {child.end() for child in children.values()} == {0}
    assert run.coupler.end() == 0
    assert run.coupler.find(type="Lost") == []
    with h5py.File(run.folder / "run.h5") as file:
        assert file.attrs["outcome"] == "completed"


@pytest.mark.skipif(not hasattr(resource, "prlimit"), reason="only Linux limits other processes")
def test_a_full_disk_ends_the_run_and_leaves_its_record(start: Start) -> None:
    run = start(time__end=8000)
    size = (run.folder / "run.h5").stat().st_size
    resource.prlimit(run.coupler.process.pid, resource.RLIMIT_FSIZE, (size, size))
    children = run.join_all("--pause", "0.005")
    failed = run.coupler.wait_for(type="ServiceFailed")
    assert failed["who"] == "coupler"
    assert "run.h5 cannot be written: File too large" in failed["message"]
    assert run.coupler.end() == 3
    for child in children.values():
        assert child.end() == 3
        assert "cannot be written" in child.wait_for(error=...)["message"]
    with h5py.File(run.folder / "run.h5") as file:
        assert "cannot be written" in file.attrs["outcome"]


def test_a_deleted_folder_ends_the_run(start: Start) -> None:
    run = start(time__end=8000)
    children = running(run)
    shutil.rmtree(run.folder)
    failed = run.coupler.wait_for(type="ServiceFailed")
    assert "run.h5 was deleted or replaced" in failed["message"]
    assert run.coupler.end() == 3
    assert {child.end() for child in children.values()} == {3}

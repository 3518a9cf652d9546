"""Runs that are recorded and replayed: the coupler, ranks and players as processes, over Zenoh."""

from __future__ import annotations

import json
import resource
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path

import h5py
import pytest

from gimpmd_schemas.wire.recording import RECORDING, open_recording
from gimpmd_schemas.wire.replay import Compared, Replay, load_result, write_settings
from tests.mpi import MPIEXEC
from tests.services.coupler.conftest import Child, Run

LAST = 20


@pytest.fixture
def recorded(start: Callable[..., Run], tmp_path: Path) -> Path:
    """The recording of a run of two ranks of the MD side and one of the continuum."""
    run = start(record=True, time__end=0.08 * LAST)
    ranks = run.join_all()
    assert [one.end() for one in ranks.values()] == [0, 0, 0]
    assert run.coupler.end() == 0
    return (tmp_path / RECORDING).rename(tmp_path / "kept.frames")


def replay(run: Run, recording: Path, side: str, *options: str) -> Compared:
    """Play a side back in a run that has begun, with ranks of the other side."""
    write_settings(run.folder, Replay(recording=str(recording), side=side))
    ranks = run.plan.ranks(side)
    words = [sys.executable, "-m", "gimpmd_coupler.replay", "--run-dir", str(run.folder)]
    launcher = [MPIEXEC, "-n", str(ranks)] if ranks > 1 else []
    player = Child(*launcher, *words, "--run", "test", "--connect", run.endpoint)
    run.children.append(player)
    live = "md" if side == "continuum" else "continuum"
    for rank in range(run.plan.ranks(live)):
        run.join(live, rank, *options)
    run.coupler.wait_for(type="Ended")
    assert player.end() == 0
    return load_result(run.folder)


def test_a_recording_has_each_step_of_each_rank_once(recorded: Path) -> None:
    with open_recording(recorded) as recording:
        steps = list(recording.steps())
    assert recording.failure == ""
    assert [one.step for one in steps] == list(range(LAST + 1))
    members = {("md", 0), ("md", 1), ("continuum", 0)}
    assert all(one.payloads.keys() == members for one in steps)
    assert all(one.reports.keys() == members for one in steps)


@pytest.mark.parametrize(("side", "count"), [("continuum", 2 * (LAST + 1)), ("md", 2 * LAST)])
def test_the_other_side_sends_the_same_bits(
    recorded: Path, start: Callable[..., Run], side: str, count: int
) -> None:
    found = replay(start(time__end=0.08 * LAST), recorded, side)
    assert found == Compared(payloads=count, differing=0, first=None, largest={})


def test_a_side_that_was_changed_is_stopped_at_its_first_difference(
    recorded: Path, start: Callable[..., Run]
) -> None:
    run = start(time__end=0.08 * LAST)
    # slow enough that the request to stop comes before the last step
    found = replay(run, recorded, "continuum", "--shift-at", "7", "--pause", "0.2")
    assert found.first is not None
    assert (found.first.step, found.first.rank, found.first.field) == (7, "md/0", "mass")
    assert found.first.largest == 0.125
    assert run.coupler.find(type="Ended")[0]["stopped"]


def test_a_run_that_failed_is_recorded_up_to_its_failure(
    start: Callable[..., Run], tmp_path: Path
) -> None:
    run = start(record=True)
    run.join_all(md0=("--die-after-part", "9"))
    assert run.coupler.end() == 3
    with open_recording(tmp_path / RECORDING) as recording:
        steps = list(recording.steps())
    assert "md/0 was lost" in recording.failure
    assert ("md", 0) in steps[8].payloads
    assert ("continuum", 0) in steps[9].payloads  # with it md/0 came to its death


@pytest.mark.long
def test_a_full_disk_ends_the_run_and_leaves_what_was_recorded(start: Callable[..., Run]) -> None:
    run = start(record=True, time__end=8000)
    room = 2**20  # run.h5 needs half of it
    resource.prlimit(run.coupler.process.pid, resource.RLIMIT_FSIZE, (room, room))
    ranks = run.join_all("--pause", "0.001")
    failed = run.coupler.wait_for(type="ServiceFailed")
    assert f"{RECORDING} cannot be written: File too large" in failed["message"]
    assert run.coupler.end() == 3
    assert {one.end() for one in ranks.values()} == {3}
    with open_recording(run.folder / RECORDING) as recording:
        assert all(len(one.payloads) == 3 for one in recording.steps())
    with h5py.File(run.folder / "run.h5") as file:
        assert "cannot be written" in file.attrs["outcome"]


@pytest.mark.long  # the lease of the connection has to expire
def test_a_process_in_a_debugger_may_stand_still_for_long(start: Callable[..., Run]) -> None:
    run = start("--deadline", "inf", time__end=8)
    ranks = run.join_all("--pause", "0.05")
    run.coupler.wait_for(type="Progress")
    ranks["md1"].kill(signal.SIGSTOP)
    time.sleep(8.0)
    ranks["md1"].kill(signal.SIGCONT)
    assert [one.end() for one in ranks.values()] == [0, 0, 0], json.dumps(run.coupler.lines)
    assert run.coupler.end() == 0

"""Strangers are refused with the reason and both values."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any

import h5py
import numpy as np
import pytest

from gimpmd_coupler.bus.connection import Answer, Connection, connect
from gimpmd_coupler.bus.settings import RECONNECT_SECONDS
from gimpmd_schemas.wire.energies import Energies
from gimpmd_schemas.wire.messages import (
    PROTOCOL_VERSION,
    Accepted,
    Failed,
    Grant,
    Refused,
    Register,
    Report,
    StepReport,
    decode,
    encode,
)

pytestmark = pytest.mark.timeout(60)
Start = Callable[..., Any]


def test_a_service_with_another_plan_is_refused_and_the_run_goes_on(start: Start) -> None:
    """``test_roster.py`` has all that may differ."""
    run = start()
    stranger = run.join("md", 0, "--change", json.dumps({"units": "metal"}))
    assert stranger.end() == 3
    error = stranger.wait_for(error="RefusedError")
    said = "unit style differs: the coupler has 'lj', the service 'metal'"
    assert said in error["message"]
    children = run.join_all()
    assert run.coupler.end() == 0
    assert {child.end() for child in children.values()} == {0}


def test_another_run_finds_no_coupler(start: Start) -> None:
    run = start()
    stranger = run.join("md", 0, "--run", "other")
    assert stranger.end() == 3
    assert "coupler" in stranger.wait_for(error="PeerLostError")["message"]


def test_a_second_of_the_same_rank_is_refused_and_the_run_goes_on(start: Start) -> None:
    run = start(time__end=8000)
    first = run.join("md", 0)
    run.coupler.wait_for(type="Registered", who="md/0")
    second = run.join("md", 0)
    assert second.end() == 3
    assert "md/0 is already taken by process" in second.wait_for(error="RefusedError")["message"]
    time.sleep(RECONNECT_SECONDS + 0.5)  # that it has gone is no loss of the first
    others = [run.join("md", 1), run.join("continuum")]
    run.coupler.wait_for(type="Progress", step=0)
    first.kill()
    assert run.coupler.wait_for(type="Lost")["who"] == "md/0"
    assert {child.end() for child in others} == {3}


def test_a_need_that_nobody_offers_ends_the_run_for_all(start: Start) -> None:
    run = start()
    children = run.join_all(md1=("--needs", "77"))
    assert run.coupler.end() == 3
    failed = run.coupler.wait_for(type="ServiceFailed")
    assert "md/1 needs node 77: not offered by continuum/0" in failed["message"]
    for child in children.values():
        assert child.end() == 3
        assert "node 77" in child.wait_for(error=...)["message"]


def energies(kinetic: float, dim: int = 2) -> Energies:
    return Energies(
        kinetic=kinetic,
        potential=0.0,
        external_work=0.0,
        interface_work=0.0,
        dissipated=0.0,
        mass=1.0,
        momentum=(0.0,) * dim,
    )


def ask(connection: Connection, kind: Any, frame: bytes) -> bytes:
    """The coupler's answer to a request."""
    connection.request(kind, frame)
    answer = connection.receive(5.0)
    assert isinstance(answer, Answer)
    return answer.data


def registration(run: Any, /, **changes: Any) -> bytes:
    fields = {
        "protocol": PROTOCOL_VERSION,
        "run": "test",
        "plan": run.plan.digest(),
        "role": "md",
        "rank": 0,
        "ranks": 2,
        "backend": "raw",
        "units": "lj",
        "dt": run.plan.step,
        "patch": run.plan.domain.box,
        "host": "elsewhere",
        "pid": 1,
    }
    ids = np.arange(3)
    return encode(Register(**(fields | changes)), {"offers": ids, "needs": ids[:0]})


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"protocol": 9},
            f"protocol version differs: the coupler has {PROTOCOL_VERSION}, the service 9",
        ),
        ({"run": "old"}, "run id differs: the coupler has 'test', the service 'old'"),
        ({"ranks": 3}, "number of md ranks differs: the coupler has 2, the service 3"),
        ({"role": "continuum", "ranks": 1}, "arrived on the key of md/0"),
    ],
)
def test_raw_registrations(start: Start, changes: dict[str, Any], words: str) -> None:
    run = start()
    with connect(run.endpoint, "test", "md", 0) as connection:
        answer, _ = decode(ask(connection, "register", registration(run, **changes)), Refused)
    assert words in answer.reason
    assert not answer.lost


def test_what_is_no_message_is_refused(start: Start) -> None:
    run = start()
    with connect(run.endpoint, "test", "md", 0) as connection:
        for frame in (b"hello", registration(run)[:-1] + b"\7", b""):
            answer, _ = decode(ask(connection, "report", frame), Refused)
            assert "message" in answer.reason


def report(*steps: int, dim: int = 2) -> bytes:
    """A report of some steps; the kinetic energy at step k is k + 1."""
    return encode(
        Report(
            role="md",
            rank=0,
            steps=tuple(
                StepReport(step=step, energies=energies(1.0 + step, dim), timings={})
                for step in steps
            ),
            peak_memory=1,
        )
    )


def test_each_step_counts_once(start: Start) -> None:
    """A report that is sent again changes nothing, and one that leaves out a step is refused."""
    run = start(only="md", md__ranks=1, time__end=0.24)
    assert run.plan.steps == 3
    with connect(run.endpoint, "test", "md", 0) as connection:

        def refused(frame: bytes) -> str:
            return decode(ask(connection, "report", frame), Refused)[0].reason

        def granted(frame: bytes) -> Grant:
            return decode(ask(connection, "report", frame), Grant)[0]

        assert "reports before it has registered" in refused(report(0))
        hello = registration(run, ranks=1)
        accepted = {ask(connection, "register", hello) for _ in range(3)}
        assert len(accepted) == 1
        assert decode(accepted.pop(), Accepted)[0].last_step == 3
        assert "reports step 1 after step -1" in refused(report(1))
        assert "momentum with 3 components" in refused(report(0, dim=3))
        for _ in range(3):
            assert granted(report(0)).done == 0
        assert granted(report(0, 1)).done == 1
        assert "reports step 3 after step 1" in refused(report(3))
        answers = {granted(report(2, 3)) for _ in range(3)}
        assert answers == {Grant(granted=3, last=3, done=3, checkpoints=(3,))}
    assert run.coupler.end() == 0
    with h5py.File(run.folder / "run.h5") as file:
        np.testing.assert_array_equal(file["series/step"], np.arange(4))
        np.testing.assert_array_equal(file["series/md/kinetic"], 1.0 + np.arange(4))


def test_a_rank_that_dies_before_its_last_report_is_named(start: Start) -> None:
    run = start()
    children = run.join_all("--pause", "0.001", md1=("--die-after-part", str(run.plan.steps)))
    assert run.coupler.end() == 3
    assert run.coupler.wait_for(type="Lost")["who"] == "md/1"
    # the other rank had finished, unless it sent its report after the loss was known
    assert children["md0"].end() in (0, 3)


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ("--skip-at", "md/1 exchanges step 4 after step 2"),
        ("--nan-at", "md/1 sends at step 3 'velocity' that is not finite"),
        ("--raise-at", "RuntimeError: lost my marbles"),
    ],
)
def test_whoever_breaks_is_named_and_its_peers_are_told(
    start: Start, option: str, words: str
) -> None:
    run = start()
    children = run.join_all("--pause", "0.01", md1=(option, "3"))
    assert run.coupler.end() == 3
    failed = run.coupler.wait_for(type="ServiceFailed")
    assert failed["who"] == "md/1"
    assert words in failed["message"]
    for who in ("md0", "continuum0"):
        assert children[who].end() == 3
        message = children[who].wait_for(error="PeerLostError")["message"]
        assert "md/1 failed" in message
        assert words in message
    assert children["md1"].end() != 0


@pytest.mark.parametrize(
    ("culprit", "words"),
    [
        ("continuum/0", "it says that continuum/0 is at fault: bad numbers"),
        ("md/0", "bad numbers"),
        ("nobody/9", "bad numbers"),
    ],
)
def test_who_blames_another_rank_is_named(start: Start, culprit: str, words: str) -> None:
    """Payloads do not pass through the coupler, so it cannot check whom a rank blames."""
    run = start()
    failed = Failed(role="md", rank=0, message="bad numbers", exit_code=3, culprit=culprit)
    with connect(run.endpoint, "test", "md", 0) as connection:
        answer, _ = decode(ask(connection, "failed", encode(failed)), Refused)
    assert run.coupler.end() == 3
    event = run.coupler.wait_for(type="ServiceFailed")
    assert (event["who"], event["message"]) == ("md/0", words)
    assert answer == Refused(reason=f"md/0 failed: {words}", lost="md/0")

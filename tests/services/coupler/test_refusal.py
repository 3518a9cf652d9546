"""Strangers are refused with the reason and both values."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any

import h5py
import numpy as np
import pytest

from gimpmd_coupler.bus import RECONNECT_SECONDS, connect
from gimpmd_schemas.wire.energies import Energies
from gimpmd_schemas.wire.messages import (
    PROTOCOL_VERSION,
    Accepted,
    Exchange,
    Refused,
    Register,
    Reply,
    Report,
    decode,
    encode,
)

pytestmark = pytest.mark.timeout(60)
Start = Callable[..., Any]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"units": "metal"}, "unit style differs: the coupler has 'lj', the service 'metal'"),
        (
            {"step": 0.04},
            "coupling time step differs: the coupler has 0.08, the service 0.04",
        ),
        ({"name": "another"}, "plan digest differs: the coupler has '"),
    ],
)
def test_a_service_with_another_plan_is_refused_and_the_run_goes_on(
    start: Start, change: dict[str, Any], words: str
) -> None:
    run = start()
    stranger = run.join("md", 0, "--change", json.dumps(change))
    assert stranger.end() == 3
    error = stranger.wait_for(error="RefusedError")
    assert words in error["message"]
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
        answer, _ = decode(connection.ask("register", registration(run, **changes), 5.0), Refused)
    assert words in answer.reason
    assert not answer.lost


def test_what_is_no_message_is_refused(start: Start) -> None:
    run = start()
    with connect(run.endpoint, "test", "md", 0) as connection:
        for frame in (b"hello", registration(run)[:-1] + b"\7", b""):
            answer, _ = decode(connection.ask("exchange", frame, 5.0), Refused)
            assert "message" in answer.reason


def test_exactly_once(start: Start) -> None:
    """A step asked again is answered again, the same; one out of order is refused."""
    run = start(only="md", md__ranks=1)

    def report(step: int) -> Report:
        return Report(
            role="md", rank=0, step=step, energies=energies(1.0), timings={}, peak_memory=1
        )

    def part(step: int) -> bytes:
        message = Exchange(
            protocol=PROTOCOL_VERSION,
            run="test",
            plan=run.plan.digest(),
            role="md",
            rank=0,
            step=step,
            time=0.0,
            report=report(step - 1) if step else None,
        )
        return encode(message)

    with connect(run.endpoint, "test", "md", 0) as connection:
        answer, _ = decode(connection.ask("exchange", part(0), 5.0), Refused)
        assert "before it has registered" in answer.reason
        hello = registration(run, ranks=1)
        accepted = {connection.ask("register", hello, 5.0) for _ in range(3)}
        assert len(accepted) == 1
        assert decode(accepted.pop(), Accepted)[0].last_step == run.plan.steps
        for step in range(5):
            answers = {connection.ask("exchange", part(step), 5.0) for _ in range(3)}
            assert len(answers) == 1
        for step in (2, 9):
            answer, _ = decode(connection.ask("exchange", part(step), 5.0), Refused)
            assert f"md/0 sends step {step} but is at step 5" in answer.reason


def test_reports_arrive_step_by_step(start: Start) -> None:
    """Every part brings the report of the previous step; the last report is sent by itself."""
    run = start(only="md", md__ranks=1, time__end=0.24)
    assert run.plan.steps == 3

    def report(step: int, dim: int = 2) -> Report:
        return Report(
            role="md",
            rank=0,
            step=step,
            energies=energies(1.0 + step, dim),
            timings={},
            peak_memory=1,
        )

    def part(step: int, before: Report | None) -> bytes:
        return encode(
            Exchange(
                protocol=PROTOCOL_VERSION,
                run="test",
                plan=run.plan.digest(),
                role="md",
                rank=0,
                step=step,
                time=0.0,
                report=before,
            )
        )

    with connect(run.endpoint, "test", "md", 0) as connection:

        def refused(kind: str, frame: bytes) -> str:
            return decode(connection.ask(kind, frame, 5.0), Refused)[0].reason

        connection.ask("register", registration(run, ranks=1), 5.0)
        connection.ask("exchange", part(0, None), 5.0)
        assert "md/0 sends no report of step 0" in refused("exchange", part(1, None))
        assert "it must be its own report of step 0" in refused("exchange", part(1, report(1)))
        assert "momentum with 3 components" in refused("exchange", part(1, report(0, dim=3)))
        for step in (1, 2, 3):
            answer = connection.ask("exchange", part(step, report(step - 1)), 5.0)
            assert decode(answer, Reply)[0].directive == ("stop" if step == 3 else "advance")
        assert "it must be its own report of step 3" in refused("report", encode(report(2)))
        answers = {connection.ask("report", encode(report(3)), 5.0) for _ in range(3)}
        assert decode(answers.pop(), Reply)[0].step == 3
        assert not answers
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
        ("--skip-at", "sends step 4 but is at step 3"),
        ("--nan-at", "'velocity' that is not finite at step 3"),
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

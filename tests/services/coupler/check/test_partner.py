"""The coupler and the other side, as a rank sees them, without a bus."""

from __future__ import annotations

from queue import SimpleQueue
from typing import Any

import numpy as np
import pytest

from gimpmd_coupler.bus.settings import UNASKED
from gimpmd_coupler.bus.stage import Heard
from gimpmd_coupler.check.log import UnmetError
from gimpmd_coupler.check.partner import Partner
from gimpmd_schemas.wire.messages import Grant, Payload, Report, StepReport, decode, encode
from tests.services.coupler.check.strip import strip_plan

NUMBER = b"a report's number"[:16]


class FakeStage:
    """Keeps what is said to the rank; the test says what the rank says."""

    def __init__(self) -> None:
        self.heard: SimpleQueue[Heard] = SimpleQueue()
        self.answers: list[tuple[bytes, bytes]] = []

    def answer(self, who: str, frame: bytes, number: bytes = UNASKED) -> None:
        self.answers.append((frame, number))

    def say(self, kind: str, frame: bytes, number: bytes = b"") -> None:
        self.heard.put(Heard(kind, "continuum/0", frame, number, 0.0))

    def report(self, *steps: int, number: bytes = NUMBER, holds: int | None = None) -> None:
        made = tuple(StepReport(step=step, energies=None, timings={}) for step in steps)
        message = Report(role="continuum", rank=0, steps=made, peak_memory=1, holds=holds)
        self.say("report", encode(message), number)

    def grants(self) -> list[tuple[Grant, bytes]]:
        return [(decode(frame, Grant)[0], number) for frame, number in self.answers]


class Running:
    """A process that does not end."""

    code = None

    def state(self) -> str:
        return "the service runs"


@pytest.fixture
def stage() -> FakeStage:
    return FakeStage()


@pytest.fixture
def partner(stage: FakeStage, tmp_path: Any) -> Partner:
    found = Partner(stage, Running(), strip_plan(), "continuum", tmp_path, 0.2)
    found.ranks[0].offers = found.ranks[0].needs = np.arange(3)
    found.take_nodes()
    found.accept(last=100, granted=4)
    stage.answers.clear()
    return found


def test_a_report_is_answered_when_the_rank_may_advance(partner: Partner, stage: FakeStage) -> None:
    stage.report(0, 1)
    partner.listen(0.1)
    ((grant, number),) = stage.grants()
    assert (grant.granted, number) == (4, NUMBER)
    stage.report(2, 3)
    partner.listen(0.1)
    assert len(stage.grants()) == 1  # it stands at step 4, and may not go on
    partner.grant(20)
    assert stage.grants()[1][0].granted == 20


def test_a_report_with_a_gap_is_noticed(partner: Partner, stage: FakeStage) -> None:
    stage.report(0)
    stage.report(2)
    with pytest.raises(UnmetError, match="one of \\[2\\]"):
        partner.listen(0.2)


def test_a_report_that_comes_twice_counts_once(partner: Partner, stage: FakeStage) -> None:
    stage.report(0, 1)
    stage.report(0, 1)
    stage.report(2)
    partner.listen(0.3)
    assert partner.reported == 2


def test_a_report_that_crosses_a_recall_is_answered(partner: Partner, stage: FakeStage) -> None:
    partner.recall()
    stage.report(0)
    partner.listen(0.1)
    grant, number = stage.grants()[-1]
    assert (grant.recall, number) == (True, NUMBER)
    stage.report(number=b"another number!!", holds=2)
    partner.listen(0.1)
    assert partner.ranks[0].holds == 2
    assert len(stage.grants()) == 2  # it stays until the end is named
    partner.end_at(3)
    grant, number = stage.grants()[-1]
    assert (grant.recall, grant.last, number) == (False, 3, b"another number!!")


def test_payloads_must_follow_one_another(partner: Partner, stage: FakeStage) -> None:
    fields = {"velocity": np.zeros((3, 2))}
    for step in (0, 2):
        message = Payload(role="continuum", rank=0, step=step)
        stage.say("data", encode(message, fields))
    assert partner.payload(0)["velocity"].shape == (3, 2)
    with pytest.raises(UnmetError, match="expected the payload of step 1, came that of step 2"):
        partner.payload(1)


@pytest.mark.parametrize(
    ("array", "came"),
    [
        (np.zeros((2, 2)), "float64 of shape"),
        (np.zeros((3, 2), dtype=np.float32), "float32"),
        (np.full((3, 2), np.inf), "not finite"),
    ],
)
def test_fields_must_fit(partner: Partner, stage: FakeStage, array: Any, came: str) -> None:
    message = Payload(role="continuum", rank=0, step=0)
    stage.say("data", encode(message, {"velocity": array}))
    with pytest.raises(UnmetError, match=came):
        partner.payload(0)


def test_what_does_not_come_is_said(partner: Partner) -> None:
    partner.first = -10
    with pytest.raises(UnmetError, match="the payload of step 0, came nothing"):
        partner.payload(0)

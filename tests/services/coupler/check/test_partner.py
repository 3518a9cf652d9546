"""The coupler and the other side, as a rank sees them, without a bus."""

from __future__ import annotations

from queue import SimpleQueue
from typing import Any

import msgspec
import numpy as np
import pytest

from gimpmd_coupler.bus.settings import UNASKED
from gimpmd_coupler.bus.stage import Heard
from gimpmd_coupler.check.log import UnmetError
from gimpmd_coupler.check.partner import Partner
from gimpmd_schemas.wire.messages import (
    Accepted,
    Grant,
    Payload,
    Report,
    StepReport,
    decode,
    encode,
)
from tests.services.coupler.check.strip import strip_plan

NUMBER = b"a report's number"[:16]


class FakeStage:
    """Keeps what is said to the rank; the test says what the rank says."""

    def __init__(self) -> None:
        self.heard: SimpleQueue[Heard] = SimpleQueue()
        self.answers: list[tuple[bytes, bytes]] = []
        self.sent: dict[str, Any] = {}

    def answer(self, who: str, frame: bytes, number: bytes = UNASKED) -> None:
        self.answers.append((frame, number))

    def say(self, kind: str, frame: bytes, number: bytes = b"", rank: int = 0) -> None:
        self.heard.put(Heard(kind, f"continuum/{rank}", frame, number, 0.0))

    def send(self, who: str, frame: bytes) -> None:
        self.sent[who] = decode(frame, Payload)[1]

    def report(
        self, *steps: int, number: bytes = NUMBER, holds: int | None = None, rank: int = 0
    ) -> None:
        made = tuple(StepReport(step=step, energies=None, timings={}) for step in steps)
        message = Report(role="continuum", rank=rank, steps=made, peak_memory=1, holds=holds)
        self.say("report", encode(message), number, rank)

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


@pytest.fixture
def of_two(stage: FakeStage, tmp_path: Any) -> Partner:
    """A service on two ranks, against three ranks of the other side."""
    plan, replace = strip_plan(), msgspec.structs.replace
    plan = replace(
        plan, md=replace(plan.atoms, ranks=3), continuum=replace(plan.continuum, ranks=2)
    )
    found = Partner(stage, Running(), plan, "continuum", tmp_path, 0.2)
    for rank, ids in zip(found.ranks, ([7, 5, 3, 1], [2, 6]), strict=True):
        rank.offers = rank.needs = np.array(ids)
    found.take_nodes()
    found.accept(last=100, granted=4)
    return found


def test_ranks_are_told_where_their_nodes_come_from(of_two: Partner, stage: FakeStage) -> None:
    """Node i has the value 10 i, wherever it comes from."""
    nodes = np.array([1, 2, 3, 5, 6, 7])
    np.testing.assert_array_equal(of_two.needs, nodes)
    of_two.send(0, {"force": 10.0 * nodes})
    for rank, (frame, _) in zip(of_two.ranks, stage.answers, strict=False):
        accepted, arrays = decode(frame, Accepted)
        found = np.full(rank.needs.size, np.nan)
        for k in accepted.sources:
            sent = stage.sent[f"md/{k}"]["force"]
            found[arrays[f"places_{k}"]] = sent[arrays[f"rows_{k}"]]
        np.testing.assert_array_equal(found, 10.0 * rank.needs)


def test_payloads_of_ranks_are_put_together(of_two: Partner, stage: FakeStage) -> None:
    for number, rank in enumerate(of_two.ranks):
        fields = {"velocity": np.stack([rank.offers, -rank.offers], axis=1).astype(float)}
        message = Payload(role="continuum", rank=number, step=0)
        stage.say("data", encode(message, fields), rank=number)
    np.testing.assert_array_equal(of_two.payload(0)["velocity"][:, 0], [1, 2, 3, 5, 6, 7])
    assert of_two.steps == [0]


def test_the_last_report_is_answered_when_all_ranks_have_sent_theirs(
    of_two: Partner, stage: FakeStage
) -> None:
    of_two.end_at(1)
    stage.answers.clear()
    stage.report(0, 1, rank=0)
    of_two.listen(0.1)
    assert stage.answers == []
    assert of_two.reported == -1
    stage.report(0, 1, rank=1)
    of_two.listen(0.1)
    assert [grant.done for grant, _ in stage.grants()] == [1, 1]

"""The lockstep clock under random ranks, orders and repetitions."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gimpmd_coupler.rendezvous import SERIAL, Answer, Rendezvous
from gimpmd_schemas.errors import ProtocolError


def test_serial_order_gives_the_md_the_next_part_of_the_continuum() -> None:
    clock: Rendezvous[str] = Rendezvous({"md": 1, "continuum": 1}, SERIAL, 0, 9)
    assert clock.submit(("md", 0), 0, "m0") == []
    answer = Answer(("continuum", 0), 0, "advance", ("md", 0))
    assert clock.submit(("continuum", 0), 0, "c0") == [answer]
    answer = Answer(("md", 0), 0, "advance", ("continuum", 1))
    assert clock.submit(("continuum", 0), 1, "c1") == [answer]
    assert clock.parts("continuum", 1) == ["c1"]


def test_one_side_alone_is_answered_at_once() -> None:
    clock: Rendezvous[str] = Rendezvous({"md": 1}, {"md": None}, 0, 2)
    told = [clock.submit(("md", 0), step, "m") for step in range(3)]
    assert [a.directive for (a,) in told] == ["advance", "advance", "stop"]
    assert all(a.source is None for (a,) in told)
    assert clock.finished()


def test_the_last_step_waits_for_both_sides() -> None:
    clock: Rendezvous[str] = Rendezvous({"md": 1, "continuum": 1}, SERIAL, 0, 0)
    assert clock.submit(("continuum", 0), 0, "c") == []
    answers = clock.submit(("md", 0), 0, "m")
    assert {a.directive for a in answers} == {"stop"}
    assert len(answers) == 2
    assert clock.finished()


@pytest.mark.parametrize("step", [-1, 1, 7])
def test_a_wrong_step_is_refused_with_both_values(step: int) -> None:
    clock: Rendezvous[str] = Rendezvous({"md": 1, "continuum": 1}, SERIAL, 0, 9)
    with pytest.raises(ProtocolError, match=rf"md/0 sends step {step} but is at step 0"):
        clock.submit(("md", 0), step, "m")


def test_nothing_follows_the_stop() -> None:
    clock: Rendezvous[str] = Rendezvous({"md": 1}, {"md": None}, 0, 0)
    clock.submit(("md", 0), 0, "m")
    with pytest.raises(ProtocolError, match="told to stop"):
        clock.submit(("md", 0), 1, "m")


class Driver:
    """Ranks that send their steps in any order, repeat themselves, and check what they get."""

    def __init__(self, ranks: dict[str, int], schedule: object, last: int) -> None:
        self.ranks, self.schedule = ranks, schedule
        self.clock: Rendezvous[tuple[str, int, int]] = Rendezvous(ranks, schedule, 0, last)
        self.step = {(role, rank): 0 for role, n in ranks.items() for rank in range(n)}
        self.sent: set[object] = set()
        self.seen: dict[object, list[tuple[str, object]]] = {m: [] for m in self.step}
        self.recorded = -1

    def send(self, member: tuple[str, int], back: int = 0) -> None:
        step = self.step[member] - back
        if step < 0 or (back and (member, step + 1) in self.sent):
            return  # nobody repeats a step after having sent the next
        if self.seen[member] and self.seen[member][-1][0] == "stop" and not back:
            return
        self.sent.add((member, step))
        self.take(self.clock.submit(member, step, (*member, step)), repeated=bool(back))

    def take(self, answers: list[Answer], repeated: bool = False) -> None:
        for answer in answers:
            content = answer.source and tuple(self.clock.parts(*answer.source))
            told = (answer.directive, content)
            if repeated and answer.step == len(self.seen[answer.member]) - 1:
                assert told == self.seen[answer.member][answer.step]
                continue
            assert answer.step == self.step[answer.member] == len(self.seen[answer.member])
            self.seen[answer.member].append(told)
            self.step[answer.member] += 1
        while self.recorded < self.clock.last and self.clock.is_complete(self.recorded + 1):
            self.recorded += 1
            for role, count in self.ranks.items():
                expected = [(role, rank, self.recorded) for rank in range(count)]
                assert self.clock.parts(role, self.recorded) == expected


@settings(deadline=None, max_examples=200)
@given(
    md=st.integers(1, 4),
    continuum=st.integers(1, 3),
    schedule=st.sampled_from([SERIAL, None]),
    last=st.integers(0, 8),
    data=st.data(),
)
def test_any_interleaving_ends_with_the_same_answers(
    md: int, continuum: int, schedule: object, last: int, data: st.DataObject
) -> None:
    ranks = {"md": md} | ({"continuum": continuum} if schedule else {})
    driver = Driver(ranks, schedule or {"md": None}, last)
    members = list(driver.step)
    stop_after = data.draw(st.none() | st.integers(0, 20))
    count = 0
    while not driver.clock.finished():
        if count == stop_after:
            driver.take(driver.clock.stop())
        ready = [m for m in members if m in driver.clock.awaited()]
        assert ready or driver.clock.finished(), "everybody waits for everybody"
        driver.send(data.draw(st.sampled_from(ready or members)))
        driver.send(data.draw(st.sampled_from(members)), back=data.draw(st.integers(0, 1)))
        count += 1
    end = driver.clock.last
    assert end <= last
    assert driver.recorded == end
    for (role, _), told in driver.seen.items():
        assert [directive for directive, _ in told] == ["advance"] * end + ["stop"]
        source = driver.schedule[role]
        for step, (_, content) in enumerate(told[:-1]):
            if source is None:
                assert content is None
            else:
                expected = [
                    (source.role, r, step + source.offset) for r in range(ranks[source.role])
                ]
                assert list(content) == expected

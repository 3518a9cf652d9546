"""The bus itself: questions, answers, and what goes on meanwhile."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_coupler import bus
from gimpmd_coupler.bus import DIRECT_BYTES, Request, Token, connect, open_hub
from gimpmd_schemas.errors import PeerLostError

pytestmark = pytest.mark.timeout(60)


@pytest.mark.parametrize("size", [0, 1000, DIRECT_BYTES, DIRECT_BYTES + 1, 2**20, 24 * 2**20])
def test_answers_of_any_size_come_back(size: int) -> None:
    """Answers are given in the bus's own thread, which must not wait for itself."""

    def echo(event: Request | Token) -> None:
        if isinstance(event, Request):
            event.answer(event.data)

    frame = np.random.default_rng(size).bytes(size)
    with (
        open_hub("test", echo) as endpoint,
        connect(endpoint, "test", "md", 0) as one,
        connect(endpoint, "test", "md", 1) as other,
    ):
        for connection in (one, other, one):
            assert connection.ask("exchange", frame, 20.0) == frame


def test_work_is_done_once_while_the_question_is_on_its_way() -> None:
    events: list[str] = []
    held: list[Request] = []

    def hold(event: Request | Token) -> None:
        if isinstance(event, Request):
            events.append("asked")
            held.append(event)

    def work() -> None:
        while not held:  # the question is out before the work is done
            pass
        events.append("worked")
        held.pop().answer(b"yes")

    with open_hub("test", hold) as endpoint, connect(endpoint, "test", "md", 0) as connection:
        assert connection.ask("exchange", b"?", 20.0, work) == b"yes"
    assert events == ["asked", "worked"]


def test_a_question_without_an_answer_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[bytes] = []
    work: list[str] = []

    def second(event: Request | Token) -> None:
        if isinstance(event, Request):
            asked.append(event.data)
            if len(asked) == 2:
                event.answer(b"now")

    monkeypatch.setattr(bus, "REPEAT_SECONDS", 0.2)
    with open_hub("test", second) as endpoint, connect(endpoint, "test", "md", 0) as connection:
        assert connection.ask("exchange", b"?", 20.0, lambda: work.append("done")) == b"now"
    assert (asked, work) == ([b"?", b"?"], ["done"])


def test_a_coupler_that_never_answers_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bus, "REPEAT_SECONDS", 0.1)
    with (
        open_hub("test", lambda event: None) as endpoint,
        connect(endpoint, "test", "md", 0) as connection,
        pytest.raises(PeerLostError, match=r"has not answered for 0\.5 s"),
    ):
        connection.ask("exchange", b"?", 0.5)


def test_answers_to_other_questions_are_left_alone() -> None:
    """To one that was asked twice, and to those of a process that takes the rank for its own."""
    earlier: list[Request] = []

    def answer(event: Request | Token) -> None:
        if isinstance(event, Request):
            for request in [*earlier, event]:
                request.answer(request.data)
            earlier.append(event)

    with (
        open_hub("test", answer) as endpoint,
        connect(endpoint, "test", "md", 0) as mine,
        connect(endpoint, "test", "md", 0) as other,
    ):
        for number in range(5):
            for connection, who in ((mine, b"mine"), (other, b"other")):
                question = b"%s %d" % (who, number)
                assert connection.ask("exchange", question, 20.0) == question

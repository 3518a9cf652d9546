"""The bus itself: questions, answers, and what goes on meanwhile."""

from __future__ import annotations

import numpy as np
import pytest

from gimpmd_coupler.bus import DIRECT_BYTES, Request, Token, connect, open_hub

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

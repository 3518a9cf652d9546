"""The bus itself: requests and answers, payloads from rank to rank, and what is repeated."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from gimpmd_coupler.bus import connection as connection_module
from gimpmd_coupler.bus import hub as hub_module
from gimpmd_coupler.bus.connection import Answer, Connection, Payload, connect
from gimpmd_coupler.bus.hub import Request, Token, listen, open_hub
from gimpmd_schemas.errors import PeerLostError

pytestmark = pytest.mark.timeout(60)


def receive(connection: Connection, seconds: float = 20.0) -> Any:
    """The next message."""
    message = connection.receive(seconds)
    assert message is not None, f"nothing came for {seconds} s"
    return message


def ask(connection: Connection, kind: Any, frame: bytes) -> bytes:
    """The answer to a request."""
    connection.request(kind, frame)
    answer = receive(connection)
    assert isinstance(answer, Answer)
    assert answer.asked
    assert not connection.pending
    return answer.data


def until(ready: Callable[[], bool]) -> None:
    """Wait for something that happens in the bus."""
    deadline = time.monotonic() + 20.0
    while not ready():
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.mark.parametrize("size", [0, 1000, 2**20, 24 * 2**20])
def test_answers_of_any_size_come_back(size: int) -> None:
    """Requests are taken in the thread of the bus, which must not wait for itself."""

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
            assert ask(connection, "report", frame) == frame


def test_a_burst_of_requests_does_not_block_the_hub() -> None:
    """Once two dozen small frames on a live key blocked it for good."""
    import zenoh

    from gimpmd_coupler.bus.settings import AT_ONCE, config

    taken: list[Request] = []

    def answer(event: Request | Token) -> None:
        if isinstance(event, Request):
            event.answer(event.data)
            taken.append(event)

    with (
        open_hub("test", answer) as endpoint,
        connect(endpoint, "test", "md", 0) as connection,
        zenoh.open(config("client", endpoint)) as stranger,
    ):
        assert ask(connection, "report", b"before") == b"before"
        for _ in range(2000):
            stranger.put("gimpmd/test/report/md/0", b"x" * 64, attachment=b"?", **AT_ONCE)
        until(lambda: len(taken) == 2001)
        assert ask(connection, "report", b"after") == b"after"


def test_a_request_without_an_answer_is_sent_again(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[bytes] = []

    def second(event: Request | Token) -> None:
        if isinstance(event, Request):
            asked.append(event.data)
            if len(asked) == 2:
                event.answer(b"now")

    monkeypatch.setattr(connection_module, "REPEAT_SECONDS", 0.2)
    with open_hub("test", second) as endpoint, connect(endpoint, "test", "md", 0) as connection:
        assert ask(connection, "report", b"?") == b"now"
    assert asked == [b"?", b"?"]


def test_without_an_answer_nothing_is_received() -> None:
    with (
        open_hub("test", lambda event: None) as endpoint,
        connect(endpoint, "test", "md", 0) as connection,
    ):
        connection.request("report", b"?")
        assert connection.receive(0.3) is None
        assert connection.pending


def test_answers_to_other_requests_are_left_alone() -> None:
    """To one that was sent twice, and to those of a process that takes the rank for its own."""
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
                assert ask(connection, "report", question) == question


def test_what_the_coupler_says_unasked_is_told_apart() -> None:
    def answer(event: Request | Token) -> None:
        if isinstance(event, Request):
            event.tell(b"by the way")
            event.answer(b"yes")

    with open_hub("test", answer) as endpoint, connect(endpoint, "test", "md", 0) as connection:
        connection.request("report", b"?")
        assert [receive(connection) for _ in range(2)] == [
            Answer(b"by the way", asked=False),
            Answer(b"yes", asked=True),
        ]


def test_payloads_go_from_rank_to_rank_and_are_sent_again_on_request() -> None:
    with (
        open_hub("test", lambda event: None) as endpoint,
        connect(endpoint, "test", "md", 1) as sender,
        connect(endpoint, "test", "continuum", 0) as taker,
    ):
        sender.publish(0, b"too early")  # nobody has subscribed
        taker.subscribe(["md/1"])
        assert receive(taker) == Payload("md/1", b"too early")

        def again(step: int) -> Any:
            taker.ask_again("md/1", step)
            return taker.receive(0.5)

        sender.publish(1, b"one")
        assert receive(taker) == Payload("md/1", b"one")
        assert again(2) is None, "it has not been sent"
        assert again(0) == Payload("md/1", b"too early")
        sender.forget(1)
        assert again(0) is None
        assert again(1) == Payload("md/1", b"one")


@pytest.mark.parametrize(("size", "count"), [(64, 5000), (10**6, 40), (24 * 2**20, 3)])
def test_payloads_of_any_size_and_number_pass_the_coupler(
    start: Callable[..., Any], size: int, count: int
) -> None:
    """Also when its queue to the receiver is full: once this blocked the coupler for good.

    The coupler drops what the receiver does not take in time. A rank asks for that again, and so
    does this one.
    """
    endpoint = start().endpoint
    with (
        connect(endpoint, "test", "md", 0) as sender,
        connect(endpoint, "test", "continuum", 0) as taker,
    ):
        taker.subscribe(["md/0"])
        sender.publish(0, b"hello")
        assert receive(taker) == Payload("md/0", b"hello")
        sender.forget(1)
        for step in range(1, count + 1):
            sender.publish(step, step.to_bytes(8, "little") + bytes(size))
        steps = take_steps(taker)
        until(lambda: len(steps) == count or ask_again(taker, steps, count))


def take_steps(taker: Connection) -> set[int]:
    """Steps of the payloads that come until there is silence."""
    steps = set()
    while (message := taker.receive(0.5)) is not None:
        if message.data != b"hello":  # sent again when the bus tells the sender who takes it
            steps.add(int.from_bytes(message.data[:8], "little"))
    return steps


def ask_again(taker: Connection, steps: set[int], count: int) -> bool:
    """Ask for the steps that are missing, take what comes, and tell whether that was all."""
    for step in sorted(set(range(1, count + 1)) - steps):
        taker.ask_again("md/0", step)
    steps.update(take_steps(taker))
    return len(steps) == count


WITHOUT_MEMORY = """
import resource
import sys
from pathlib import Path

from gimpmd_coupler.bus.hub import open_hub

with open_hub("test", lambda event: None) as endpoint:
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + 2**20  # less than the stack of a thread
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    print(endpoint, flush=True)
    sys.stdin.read()
"""


def test_ranks_get_in_if_the_coupler_has_no_memory_for_further_threads() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", WITHOUT_MEMORY], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as coupler:
        assert coupler.stdout is not None
        endpoint = coupler.stdout.readline().decode().strip()
        with connect(endpoint, "test", "md", 0) as connection:
            connection.request("register", b"let me in")
        coupler.kill()


def test_a_bus_that_lets_nobody_in_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hub_module, "KNOCK_SECONDS", 0.2)
    with (
        listen() as (_, endpoint),  # a router to whose requests nobody subscribes
        pytest.raises(PeerLostError, match="lets nobody in: this process may have no memory"),
    ):
        hub_module._knock(endpoint, "gimpmd/test/register/coupler/0")

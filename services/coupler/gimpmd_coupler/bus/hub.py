"""The end of the bus at the coupler: a router that receives requests and sends answers."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any

import zenoh

from gimpmd_coupler.bus.settings import (
    AT_ONCE,
    KINDS,
    UNASKED,
    Kind,
    config,
    prefix,
    tune_process,
)

_PORT_TRIES = 20


@dataclass(frozen=True)
class Request:
    """A request of a rank, kept until it is answered or repeated.

    Attributes
    ----------
    kind : kind of request, from its key.
    role, rank : the sender, from the key; not checked yet.
    data : the frame.
    """

    kind: Kind
    role: str
    rank: str
    data: bytes
    _number: bytes
    _sender: _Sender

    def answer(self, frame: bytes) -> None:
        """Send the answer; returns at once."""
        self._sender.send(self.role, self.rank, frame, self._number)

    def tell(self, frame: bytes) -> None:
        """Send the sender of this request a message that answers no request; returns at once."""
        self._sender.send(self.role, self.rank, frame, UNASKED)


@dataclass(frozen=True)
class Token:
    """The connection of a rank came up or went down."""

    role: str
    rank: str
    alive: bool


class _Sender:
    """Sends answers one after another in a thread of its own.

    So a rank that does not take its answers delays no other work of the coupler.
    """

    def __init__(self, session: zenoh.Session, start: str) -> None:
        self._session, self._start = session, start
        self._publishers: dict[tuple[str, str], Any] = {}
        self._queue: SimpleQueue[tuple[str, str, bytes, bytes] | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def send(self, role: str, rank: str, frame: bytes, number: bytes) -> None:
        self._queue.put((role, rank, frame, number))

    def close(self) -> None:
        """Send what is left, and end."""
        self._queue.put(None)
        self._thread.join()

    def _run(self) -> None:
        while (item := self._queue.get()) is not None:
            role, rank, frame, number = item
            if (role, rank) not in self._publishers:
                key = f"{self._start}/answer/{role}/{rank}"
                self._publishers[role, rank] = self._session.declare_publisher(key, **AT_ONCE)
            self._publishers[role, rank].put(frame, attachment=number)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def listen() -> tuple[zenoh.Session, str]:
    """Open a router on a free port. Try again if another process takes the port meanwhile."""
    for attempt in range(_PORT_TRIES):
        endpoint = f"tcp/127.0.0.1:{_free_port()}"
        try:
            return zenoh.open(config("router", [endpoint], [])), endpoint
        except zenoh.ZError:
            if attempt == _PORT_TRIES - 1:
                raise
    raise AssertionError("unreachable")


@contextmanager
def open_hub(run: str, take: Callable[[Request | Token], None]) -> Iterator[str]:
    """Open the end of the bus at the coupler.

    Parameters
    ----------
    run : str
        The run id.
    take : callable
        Called with a `Request` for every request and a `Token` for every connection that opens
        or closes, in threads of the bus. It must neither block nor raise.

    Yields
    ------
    str
        The endpoint to which ranks connect.
    """
    start = prefix(run)

    def on_request(sample: Any) -> None:
        _, _, kind, role, rank = str(sample.key_expr).split("/")
        number = sample.attachment.to_bytes() if sample.attachment is not None else UNASKED
        take(Request(kind, role, rank, sample.payload.to_bytes(), number, sender))  # type: ignore[arg-type]

    def on_token(sample: Any) -> None:
        *_, role, rank = str(sample.key_expr).split("/")
        take(Token(role, rank, sample.kind == zenoh.SampleKind.PUT))

    tune_process("router")
    session, endpoint = listen()
    with session, ExitStack() as entities:
        sender = _Sender(session, start)
        entities.callback(sender.close)
        for kind in KINDS:
            requests = session.declare_subscriber(f"{start}/{kind}/*/*", on_request)
            entities.enter_context(requests)
        subscriber = session.liveliness().declare_subscriber(
            f"{start}/alive/*/*", on_token, history=True
        )
        entities.enter_context(subscriber)
        yield endpoint

"""The end of the bus at the coupler: a router that receives requests and sends answers."""

from __future__ import annotations

import tempfile
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
    UNIX,
    Kind,
    config,
    prefix,
    tune_process,
)

_LONGEST_BASE = 80
"""Longest name of a folder for sockets, bytes; a socket's own name has at most 107."""


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


@contextmanager
def listen() -> Iterator[tuple[zenoh.Session, str]]:
    """Open a router on a Unix socket in a new folder that only this user may enter.

    Yields
    ------
    tuple of zenoh.Session and str
        The router, and the endpoint to which ranks connect.
    """
    base = tempfile.gettempdir() if len(tempfile.gettempdir()) < _LONGEST_BASE else "/tmp"
    tune_process("router")
    with tempfile.TemporaryDirectory(prefix="gimpmd-", dir=base) as folder:
        endpoint = f"{UNIX}/{folder}/bus"
        with zenoh.open(config("router", [endpoint], [])) as session:
            yield session, endpoint


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

    with listen() as (session, endpoint), ExitStack() as entities:
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

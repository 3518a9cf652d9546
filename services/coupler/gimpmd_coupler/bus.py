"""The bus. This is the only module that uses Zenoh.

The coupler is a router on one loopback port; every rank is a client with one connection. Ranks
send requests, and the coupler answers them. The settings follow measurements on Zenoh 1.10: no
discovery, no shared memory, a short lease, long queues.

Requests and answers are publications. A Zenoh query would need four messages and its clock in
place of two messages, which costs 0.4 ms more per coupling step beside LAMMPS. The sender of a
publication does not learn whether it arrived. So each request has a number, which its answer
repeats, and it is sent again until the answer arrives.
"""

from __future__ import annotations

import ctypes
import json
import os
import re
import secrets
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any, Literal, get_args

import zenoh

from gimpmd_schemas.errors import PeerLostError, ProtocolError

Kind = Literal["register", "exchange", "report", "failed"]
KINDS: tuple[Kind, ...] = get_args(Kind)

MAX_MESSAGE = 256 * 2**20
"""Largest frame, bytes. Zenoh drops larger frames silently, so we refuse to send them."""

CONNECT_SECONDS = 5.0
"""Time after which a rank that finds no coupler gives up."""

RECONNECT_SECONDS = 2.0
"""Time after which a broken connection counts as lost."""

REPEAT_SECONDS = 5.0
"""Time after which a request without an answer is sent again."""

DIRECT_BYTES = 2**19
"""Larger answers are sent by a separate thread.

A Zenoh queue holds one megabyte and is emptied by the thread that calls us. If this thread waited
for room in the queue, it would wait for itself.
"""

_ONE_THREAD = (
    "(rx: (handover: app), tx: (handover: app), net: (handover: app), acc: (handover: app),"
    " app: (worker_threads: 1))"
)
_AT_ONCE: dict[str, Any] = {
    "express": True,
    "congestion_control": zenoh.CongestionControl.BLOCK,
}
_LEASE_MS = 2000
_POLL_SECONDS = 0.002
_NAME_BYTES = _NUMBER_BYTES = 8
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
    _hub: _Hub

    def answer(self, frame: bytes) -> None:
        """Send the answer."""
        self._hub.send(self.role, self.rank, frame, self._number)


@dataclass(frozen=True)
class Token:
    """The connection of a rank came up or went down."""

    role: str
    rank: str
    alive: bool


class _Hub:
    """Sends answers: small ones at once, large ones one after another in a separate thread."""

    def __init__(self, session: zenoh.Session, prefix: str) -> None:
        self._session, self._prefix = session, prefix
        self._publishers: dict[tuple[str, str], Any] = {}
        self._large: SimpleQueue[tuple[Any, bytes, bytes] | None] = SimpleQueue()
        self._sender = threading.Thread(target=self._send_large, daemon=True)
        self._sender.start()

    def send(self, role: str, rank: str, frame: bytes, number: bytes) -> None:
        if (role, rank) not in self._publishers:
            key = f"{self._prefix}/answer/{role}/{rank}"
            self._publishers[role, rank] = self._session.declare_publisher(key, **_AT_ONCE)
        publisher = self._publishers[role, rank]
        if len(frame) > DIRECT_BYTES:
            self._large.put((publisher, frame, number))
        else:
            publisher.put(frame, attachment=number)

    def close(self) -> None:
        self._large.put(None)
        self._sender.join()

    def _send_large(self) -> None:
        while (answer := self._large.get()) is not None:
            publisher, frame, number = answer
            publisher.put(frame, attachment=number)


def _tune_process() -> None:
    """Set process options that matter more for the speed than our own work.

    One thread does all work of Zenoh, because waking several threads in turn doubles the time of a
    round trip. Large buffers stay mapped, because fresh pages for every message cost more time than
    sending it.
    """
    os.environ.setdefault("ZENOH_RUNTIME", _ONE_THREAD)
    m_trim_threshold, m_top_pad, m_mmap_threshold = -1, -2, -3
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:  # glibc only
        mallopt(m_mmap_threshold, 32 << 20)
        mallopt(m_trim_threshold, 512 << 20)
        mallopt(m_top_pad, 32 << 20)


def _config(mode: str, listen: list[str], connect: list[str]) -> zenoh.Config:
    settings = {
        "mode": mode,
        "listen/endpoints": listen,
        "connect/endpoints": connect,
        "connect/timeout_ms": int(1000 * CONNECT_SECONDS),
        "connect/exit_on_failure": True,
        "connect/retry": {
            "period_init_ms": 20,
            "period_max_ms": 200,
            "period_increase_factor": 2,
        },
        "scouting/delay": 0,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
        "transport/unicast/open_timeout": 5000,
        "transport/unicast/accept_timeout": 5000,
        "transport/link/protocols": ["tcp"],
        "transport/link/tx/lease": _LEASE_MS,
        "transport/link/tx/keep_alive": 4,
        "transport/link/tx/queue/size/data": 16,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": 30_000_000,
        "transport/link/rx/max_message_size": MAX_MESSAGE,
        "adminspace/enabled": False,
        "plugins_loading/enabled": False,
    }
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def check_run_id(run: str) -> str:
    """Return the run id if it can be part of a key.

    Raises
    ------
    ValueError
        It is empty or contains characters with a special meaning on the bus.
    """
    if not re.fullmatch(r"[A-Za-z0-9._-]+", run):
        raise ValueError(f"run id {run!r} must be made of letters, digits and . _ -")
    return run


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _listen() -> tuple[zenoh.Session, str]:
    """Open a router on a free port. Try again if another process takes the port meanwhile."""
    for attempt in range(_PORT_TRIES):
        endpoint = f"tcp/127.0.0.1:{_free_port()}"
        try:
            return zenoh.open(_config("router", [endpoint], [])), endpoint
        except zenoh.ZError:
            if attempt == _PORT_TRIES - 1:
                raise
    raise AssertionError("unreachable")


def _direct(function: Any) -> Any:
    """Let Zenoh call from its own thread, which saves a thread switch. It must never block."""
    return zenoh.handlers.Callback(function, indirect=False)


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
    prefix = f"gimpmd/{check_run_id(run)}"

    def on_request(sample: Any) -> None:
        _, _, kind, role, rank = str(sample.key_expr).split("/")
        number = sample.attachment.to_bytes() if sample.attachment is not None else b""
        take(Request(kind, role, rank, sample.payload.to_bytes(), number, hub))  # type: ignore[arg-type]

    def on_token(sample: Any) -> None:
        *_, role, rank = str(sample.key_expr).split("/")
        take(Token(role, rank, sample.kind == zenoh.SampleKind.PUT))

    _tune_process()
    session, endpoint = _listen()
    with session, ExitStack() as entities:
        hub = _Hub(session, prefix)
        entities.callback(hub.close)
        for kind in KINDS:
            requests = session.declare_subscriber(f"{prefix}/{kind}/*/*", _direct(on_request))
            entities.enter_context(requests)
        subscriber = session.liveliness().declare_subscriber(
            f"{prefix}/alive/*/*", _direct(on_token), history=True
        )
        entities.enter_context(subscriber)
        yield endpoint


class Connection:
    """The end of the bus at a rank; made by `connect`."""

    def __init__(self, endpoint: str) -> None:
        self.endpoint = endpoint
        self.publishers: dict[Kind, Any] = {}
        self._asked, self._name = 0, secrets.token_bytes(_NAME_BYTES)
        self._connected = False  # whether the coupler receives exchanges, as last reported
        self._answers: SimpleQueue[tuple[bytes, bytes] | None] = SimpleQueue()

    def take(self, sample: Any) -> None:
        """Take an answer, in a thread of the bus."""
        if sample.attachment is not None:
            self._answers.put((sample.attachment.to_bytes(), sample.payload.to_bytes()))

    def watch(self, status: zenoh.MatchingStatus) -> None:
        """Wake the thread that waits for an answer when the connection breaks."""
        self._connected = status.matching
        if not status.matching:
            self._answers.put(None)

    def ask(
        self, kind: Kind, frame: bytes, patience: float, meanwhile: Callable[[], None] | None = None
    ) -> bytes:
        """Send a request and sleep until the coupler answers.

        The same frame is sent again if the connection broke, so the coupler must recognize
        repeated requests.

        Parameters
        ----------
        kind : kind of request.
        frame : bytes
        patience : float
            Seconds after which a connected coupler that does not answer counts as lost.
        meanwhile : callable
            Called once when the request is on its way.

        Raises
        ------
        ProtocolError
            The frame is too large for the bus.
        PeerLostError
            The coupler is gone or does not answer.
        """
        if len(frame) > MAX_MESSAGE:
            raise ProtocolError(f"a message of {len(frame)} bytes exceeds {MAX_MESSAGE}")
        publisher = self.publishers[kind]
        self._asked += 1
        # another process may use the same rank by mistake; its answers come on the same key
        number = self._name + self._asked.to_bytes(_NUMBER_BYTES, "little")
        deadline = time.monotonic() + patience
        while time.monotonic() < deadline:
            if kind != "exchange" or not self._connected:
                self._wait_for_coupler(publisher)
            publisher.put(frame, attachment=number)
            work, meanwhile = meanwhile, None
            if work is not None:
                work()
            answer = self._answer_to(number)
            if answer is not None:
                return answer
        raise PeerLostError(
            f"the coupler at {self.endpoint} has not answered for {patience:g} s"
            " although it is connected: see logs/coupler.log"
        )

    def _answer_to(self, number: bytes) -> bytes | None:
        """Wait for an answer; None if the connection broke or no answer came: send again."""
        until = time.monotonic() + REPEAT_SECONDS
        while (left := until - time.monotonic()) > 0.0:
            try:
                answer = self._answers.get(timeout=left)
            except Empty:
                return None
            if answer is None:
                return None
            if answer[0] == number:  # otherwise it answers a repeated request
                return answer[1]
        return None

    def _wait_for_coupler(self, publisher: Any) -> None:
        deadline = time.monotonic() + RECONNECT_SECONDS
        while not publisher.matching_status.matching:  # the status object itself is always truthy
            if time.monotonic() > deadline:
                raise PeerLostError(
                    f"the coupler at {self.endpoint} is gone: no connection for"
                    f" {RECONNECT_SECONDS:g} s; see logs/coupler.log"
                )
            time.sleep(_POLL_SECONDS)


@contextmanager
def connect(endpoint: str, run: str, role: str, rank: int) -> Iterator[Connection]:
    """Open the end of the bus at a rank. The coupler sees the rank alive until it is closed.

    Raises
    ------
    PeerLostError
        No coupler listens at the endpoint.
    """
    prefix = f"gimpmd/{check_run_id(run)}"
    _tune_process()
    try:
        session = zenoh.open(_config("client", [], [endpoint]))
    except zenoh.ZError as error:
        raise PeerLostError(
            f"no coupler at {endpoint} within {CONNECT_SECONDS:g} s ({error}): is gimpmd-coupler"
            " running, and is this the endpoint it printed?"
        ) from None
    connection = Connection(endpoint)
    with session, ExitStack() as entities:
        # first, so that no answer is missed
        answers = session.declare_subscriber(
            f"{prefix}/answer/{role}/{rank}", _direct(connection.take)
        )
        entities.callback(answers.undeclare)
        token = session.liveliness().declare_token(f"{prefix}/alive/{role}/{rank}")
        entities.callback(token.undeclare)
        for kind in KINDS:
            publisher = session.declare_publisher(f"{prefix}/{kind}/{role}/{rank}", **_AT_ONCE)
            connection.publishers[kind] = publisher
            entities.callback(publisher.undeclare)
        listener = connection.publishers["exchange"].declare_matching_listener(connection.watch)
        entities.callback(listener.undeclare)
        yield connection

"""The end of the bus at a rank: requests to the coupler, payloads to and from other ranks."""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

import zenoh

from gimpmd_coupler.bus.keys import rank_settings
from gimpmd_coupler.bus.settings import (
    AT_ONCE,
    CONNECT_SECONDS,
    KINDS,
    RECONNECT_SECONDS,
    UNASKED,
    Kind,
    config,
    direct,
    prefix,
    tune_process,
)
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.errors import PeerLostError, ProtocolError
from gimpmd_schemas.wire.access import KEYS, TLS
from gimpmd_schemas.wire.messages import MAX_MESSAGE

REPEAT_SECONDS = 5.0
"""Time after which a request without an answer is sent again."""

_NAME_BYTES = _NUMBER_BYTES = 8
_POLL_SECONDS = 0.002
_LAST = 2  # other ranks are one step behind at most, if they wait for ours as we do for theirs
_STEP_BYTES = 8


@dataclass(frozen=True)
class Answer:
    """A frame of the coupler.

    Attributes
    ----------
    data : the frame.
    asked : whether it answers the pending request; the coupler also sends frames unasked.
    """

    data: bytes
    asked: bool


@dataclass(frozen=True)
class Payload:
    """A frame of another rank, given as ``<role>/<rank>``."""

    peer: str
    data: bytes


@dataclass(frozen=True)
class Reconnected:
    """The connection broke and came back: what came meanwhile is lost."""


@dataclass
class _Pending:
    """A request that has not been answered."""

    kind: Kind
    frame: bytes
    number: bytes
    sent: float


class Connection:
    """The end of the bus at a rank; made by `connect`.

    Parameters
    ----------
    session : zenoh.Session
    endpoint, start, me : str
        Endpoint of the coupler, what all keys begin with, and ``<role>/<rank>``.
    entities : ExitStack
        Takes what must be undeclared before the session is closed.
    """

    def __init__(
        self, session: zenoh.Session, endpoint: str, start: str, me: str, entities: ExitStack
    ) -> None:
        self.endpoint = endpoint
        self._session, self._start, self._entities = session, start, entities
        # another process may use the same rank by mistake; its answers come on the same key
        self._name, self._asked = secrets.token_bytes(_NAME_BYTES), 0
        self._pending: _Pending | None = None
        self._inbox: SimpleQueue[tuple[bytes, bytes] | Payload | Reconnected] = SimpleQueue()
        self._kept: dict[int, bytes] = {}  # payloads of the last steps
        self._lock = threading.Lock()  # guards _kept
        self._wanted: SimpleQueue[int | None] = SimpleQueue()  # steps to publish again
        # first, so that no answer is missed
        self._subscribe(f"answer/{me}", self._take_answer)
        self._subscribe(f"again/{me}", self._take_again)
        token = session.liveliness().declare_token(f"{start}/alive/{me}")
        entities.callback(token.undeclare)
        self._requests = {kind: self._publisher(f"{kind}/{me}") for kind in KINDS}
        self._payloads = self._publisher(f"data/{me}")
        self._lost_at: float | None = None
        self._listen(self._requests["report"], self._watch)
        self._listen(self._payloads, self._watch_takers)
        self._repeater = threading.Thread(target=self._repeat_payloads, daemon=True)
        self._repeater.start()
        entities.callback(self._end_repeater)

    # Requests

    @property
    def pending(self) -> bool:
        """Whether a request has not been answered yet."""
        return self._pending is not None

    def request(self, kind: Kind, frame: bytes) -> None:
        """Send a request and return; its answer is returned by `receive`.

        The same frame is sent again until the coupler answers it. There is one request at a time.

        Raises
        ------
        ProtocolError
            The frame is too large for the bus.
        PeerLostError
            The coupler is gone.
        """
        _check_size(frame)
        self._wait_for_coupler(self._requests[kind])
        self._asked += 1
        number = self._name + self._asked.to_bytes(_NUMBER_BYTES, "little")
        self._pending = _Pending(kind, frame, number, 0.0)
        self._send_request()

    def receive(self, timeout: float) -> Answer | Payload | Reconnected | None:
        """Return what comes next, or None if nothing comes within ``timeout`` seconds.

        Raises
        ------
        PeerLostError
            The coupler is gone.
        """
        until = time.monotonic() + timeout
        while True:
            self._look_after_request()
            left = until - time.monotonic()
            try:
                item = self._inbox.get(timeout=max(min(left, 0.5), 0.0))
            except Empty:
                if left <= 0.5:
                    return None
                continue
            if not isinstance(item, tuple):
                return item
            number, data = item
            if number == UNASKED:
                return Answer(data, asked=False)
            if self._pending is not None and number == self._pending.number:
                self._pending = None
                return Answer(data, asked=True)

    def _send_request(self) -> None:
        pending = self._pending
        assert pending is not None
        self._requests[pending.kind].put(pending.frame, attachment=pending.number)
        pending.sent = time.monotonic()

    def _look_after_request(self) -> None:
        """Send the pending request again if it is due, and notice that the coupler is gone."""
        if self._lost_at is not None and time.monotonic() > self._lost_at + RECONNECT_SECONDS:
            raise self._gone()
        pending = self._pending
        if pending is not None and time.monotonic() > pending.sent + REPEAT_SECONDS:
            self._wait_for_coupler(self._requests[pending.kind])
            self._send_request()

    def _wait_for_coupler(self, publisher: Any) -> None:
        deadline = time.monotonic() + RECONNECT_SECONDS
        while not publisher.matching_status.matching:  # the status object itself is always truthy
            if time.monotonic() > deadline:
                raise self._gone()
            time.sleep(_POLL_SECONDS)

    def _gone(self) -> PeerLostError:
        return PeerLostError(
            f"the coupler at {self.endpoint} is gone: no connection for"
            f" {RECONNECT_SECONDS:g} s; see logs/coupler.log"
        )

    # Payloads

    def publish(self, step: int, frame: bytes) -> None:
        """Send the payload of a step to all ranks that subscribe to it, and keep it.

        Raises
        ------
        ProtocolError
            The frame is too large for the bus.
        """
        _check_size(frame)
        with self._lock:
            self._kept[step] = frame
        self._payloads.put(frame)

    def forget(self, before: int) -> None:
        """Drop the payloads of steps before one: no rank can ask for them again."""
        with self._lock:
            for step in [step for step in self._kept if step < before]:
                del self._kept[step]

    def subscribe(self, peers: Iterable[str]) -> None:
        """Receive the payloads of other ranks, given as ``<role>/<rank>``."""
        for peer in peers:
            self._subscribe(f"data/{peer}", partial(self._take_payload, peer))

    def ask_again(self, peer: str, step: int) -> None:
        """Ask another rank to send the payload of a step once more, if it has sent it already."""
        key = f"{self._start}/again/{peer}"
        self._session.put(key, step.to_bytes(_STEP_BYTES, "little"), **AT_ONCE)

    def _repeat_payloads(self) -> None:
        while (step := self._wanted.get()) is not None:
            with self._lock:
                frame = self._kept.get(step)
            if frame is not None:
                self._payloads.put(frame)

    def _end_repeater(self) -> None:
        self._wanted.put(None)
        self._repeater.join()

    # In the thread of the bus

    def _take_answer(self, sample: Any) -> None:
        if sample.attachment is not None:
            self._inbox.put((sample.attachment.to_bytes(), sample.payload.to_bytes()))

    def _take_payload(self, peer: str, sample: Any) -> None:
        self._inbox.put(Payload(peer, sample.payload.to_bytes()))

    def _take_again(self, sample: Any) -> None:
        self._wanted.put(int.from_bytes(sample.payload.to_bytes()[:_STEP_BYTES], "little"))

    def _watch(self, status: zenoh.MatchingStatus) -> None:
        """Note when the connection broke, and tell the thread that waits when it came back."""
        if status.matching and self._lost_at is not None:
            self._inbox.put(Reconnected())
        self._lost_at = None if status.matching else time.monotonic()
        if self._pending is not None:
            self._pending.sent = 0.0  # it may have been lost

    def _watch_takers(self, status: zenoh.MatchingStatus) -> None:
        """Send the last payloads again once somebody takes them: they may have been lost."""
        if status.matching:
            with self._lock:
                last = sorted(self._kept)[-_LAST:]
            for step in last:
                self._wanted.put(step)

    def _listen(self, publisher: Any, take: Any) -> None:
        listener = publisher.declare_matching_listener(direct(take))
        self._entities.callback(listener.undeclare)

    def _subscribe(self, key: str, take: Any) -> None:
        subscriber = self._session.declare_subscriber(f"{self._start}/{key}", direct(take))
        self._entities.callback(subscriber.undeclare)

    def _publisher(self, key: str) -> Any:
        publisher = self._session.declare_publisher(f"{self._start}/{key}", **AT_ONCE)
        self._entities.callback(publisher.undeclare)
        return publisher


def _check_size(frame: bytes) -> None:
    if len(frame) > MAX_MESSAGE:
        raise ProtocolError(f"a message of {len(frame)} bytes exceeds {MAX_MESSAGE}")


@contextmanager
def enter(
    endpoint: str,
    role: Role,
    rank: int,
    keys: Path | None = None,
    patience: float = CONNECT_SECONDS,
) -> Iterator[zenoh.Session]:
    """Open a session as a rank does, with the arguments of `connect`.

    Raises
    ------
    InputError, PeerLostError
        See `connect`.
    """
    secure = None
    if endpoint.startswith(f"{TLS}/"):
        secure = rank_settings(keys or Path(KEYS), role, rank)
    tune_process("client")
    try:
        session = zenoh.open(config("client", endpoint, secure, patience))
    except zenoh.ZError as error:
        doubt = " with these keys" if secure else ""
        raise PeerLostError(
            f"no coupler at {endpoint}{doubt} within {patience:g} s ({error}): is gimpmd-coupler"
            " running, and is this the endpoint it printed?"
        ) from None
    with session:
        yield session


@contextmanager
def connect(
    endpoint: str,
    run: str,
    role: Role,
    rank: int,
    keys: Path | None = None,
    patience: float = CONNECT_SECONDS,
) -> Iterator[Connection]:
    """Open the end of the bus at a rank. The coupler sees the rank alive until it is closed.

    Parameters
    ----------
    keys : Path, optional
        Folder of the keys; needed for TLS.
    patience : float
        Seconds after which a rank that finds no coupler gives up.

    Raises
    ------
    InputError
        There are no keys.
    PeerLostError
        No coupler listens at the endpoint, or it does not accept the keys.
    """
    start = prefix(run)
    with enter(endpoint, role, rank, keys, patience) as session, ExitStack() as entities:
        yield Connection(session, endpoint, start, f"{role}/{rank}", entities)

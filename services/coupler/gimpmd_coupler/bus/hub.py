"""The end of the bus at the coupler: a router that receives requests and sends answers."""

from __future__ import annotations

import os
import stat
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import zenoh

from gimpmd_coupler.bus.keys import router_settings
from gimpmd_coupler.bus.settings import (
    AT_ONCE,
    KINDS,
    UNASKED,
    Kind,
    config,
    prefix,
    tune_process,
)
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.errors import InputError, PeerLostError, Problem
from gimpmd_schemas.wire.access import COUPLER, KEYS, ONE_EACH, TLS, UNIX

_LONGEST_SOCKET = 107
"""Longest name of a Unix socket, bytes."""
_LONGEST_BASE = 80
"""Longest name of a folder for folders of sockets."""

KNOCK_SECONDS = 5.0
"""Time within which the router must let in its first client."""


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
def listen(
    endpoint: str = "",
    run: str = "",
    keys: Path | None = None,
    ranks: Mapping[Role, int] = ONE_EACH,
) -> Iterator[tuple[zenoh.Session, str]]:
    """Open a router.

    Parameters
    ----------
    endpoint : str
        ``unixsock-stream/PATH``, in a folder that only this user may enter, or ``tls/HOST:PORT``.
        Without it: a Unix socket in a new folder.
    run : str
        The run id; needed for TLS.
    keys : Path, optional
        Folder of the keys; needed for TLS.
    ranks : mapping
        Number of ranks of each role; needed for TLS.

    Yields
    ------
    tuple of zenoh.Session and str
        The router, and the endpoint.

    Raises
    ------
    InputError
        The endpoint is not safe or cannot be used, or there are no keys.
    """
    tune_process("router")
    with ExitStack() as resources:
        if not endpoint:
            folder = tempfile.TemporaryDirectory(prefix="gimpmd-", dir=_base())
            endpoint = f"{UNIX}/{resources.enter_context(folder)}/bus"
        kind, _, place = endpoint.partition("/")
        secure = None
        if kind == UNIX:
            _check_socket(endpoint, Path(place))
            resources.callback(Path(place).unlink, missing_ok=True)
        elif kind == TLS:
            secure = router_settings(keys or Path(KEYS), prefix(run), ranks)
        else:
            raise _unusable(endpoint, "anybody could connect", f"use {UNIX}/PATH or tls/HOST:PORT")
        try:
            session = zenoh.open(config("router", endpoint, secure))
        except zenoh.ZError as error:
            raise _unusable(endpoint, str(error).split(" at /")[0], "choose another one") from None
        with session:
            yield session, endpoint


def _base() -> str:
    """Folder for folders of sockets."""
    base = tempfile.gettempdir()
    return base if len(base) < _LONGEST_BASE else "/tmp"


def _check_socket(endpoint: str, path: Path) -> None:
    folder = path.parent
    if len(os.fsencode(path)) > _LONGEST_SOCKET:
        long = f"has more than {_LONGEST_SOCKET} bytes"
        raise _unusable(endpoint, f"the name of the socket {long}", "use a shorter path")
    if not folder.is_dir():
        raise _unusable(endpoint, f"there is no folder {folder}", f"mkdir -m 700 {folder}")
    if folder.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise _unusable(endpoint, f"other users may enter {folder}", f"chmod 700 {folder}")


def _unusable(endpoint: str, why: str, hint: str) -> InputError:
    return InputError("the coupler", [Problem("--listen", endpoint, why, hint)])


@contextmanager
def open_hub(
    run: str,
    take: Callable[[Request | Token], None],
    endpoint: str = "",
    keys: Path | None = None,
    take_payload: Callable[[str, str, bytes], None] | None = None,
    ranks: Mapping[Role, int] = ONE_EACH,
) -> Iterator[str]:
    """Open the end of the bus at the coupler.

    Parameters
    ----------
    run : str
        The run id.
    take : callable
        Called with a `Request` for every request and a `Token` for every connection that opens
        or closes, in threads of the bus. It must neither block nor raise.
    endpoint, keys, ranks
        See `listen`.
    take_payload : callable, optional
        Called with role, number and frame for every payload that a rank sends to others, in a
        thread of its own. It must not raise.

    Yields
    ------
    str
        The endpoint to which ranks connect.

    Raises
    ------
    InputError
        See `listen`.
    PeerLostError
        The router lets nobody in.
    """
    start = prefix(run)

    def on_request(sample: Any) -> None:
        _, _, kind, role, rank = str(sample.key_expr).split("/")
        number = sample.attachment.to_bytes() if sample.attachment is not None else UNASKED
        if number == UNASKED:  # the rank would take the answer for something that we say unasked
            return
        take(Request(kind, role, rank, sample.payload.to_bytes(), number, sender))  # type: ignore[arg-type]

    def on_token(sample: Any) -> None:
        *_, role, rank = str(sample.key_expr).split("/")
        take(Token(role, rank, sample.kind == zenoh.SampleKind.PUT))

    def on_payload(sample: Any) -> None:
        *_, role, rank = str(sample.key_expr).split("/")
        if take_payload is not None:
            take_payload(role, rank, sample.payload.to_bytes())

    with listen(endpoint, run, keys, ranks) as (session, where), ExitStack() as entities:
        sender = _Sender(session, start)
        entities.callback(sender.close)
        for kind in KINDS:
            requests = session.declare_subscriber(f"{start}/{kind}/*/*", on_request)
            entities.enter_context(requests)
        if take_payload is not None:
            payloads = session.declare_subscriber(f"{start}/data/*/*", on_payload)
            entities.enter_context(payloads)
        subscriber = session.liveliness().declare_subscriber(
            f"{start}/alive/*/*", on_token, history=True
        )
        entities.enter_context(subscriber)
        if where.startswith(f"{UNIX}/"):  # beyond the host only ranks have keys with which to enter
            _knock(where, f"{start}/{KINDS[0]}/{COUPLER}/0")
        yield where


def _knock(endpoint: str, key: str) -> None:
    """Enter the bus once, before any rank does.

    The router starts threads for its first client. If the system denies them, for lack of memory
    or by a limit on processes, it says nothing and lets nobody in. Once started, they stay.
    """
    deadline = time.monotonic() + KNOCK_SECONDS
    try:
        with zenoh.open(config("client", endpoint)) as session:
            door: Any = session.declare_publisher(key)
            while not door.matching_status.matching:  # the status object itself is always truthy
                if time.monotonic() > deadline:
                    raise _closed(endpoint)
                time.sleep(0.001)
    except zenoh.ZError as error:
        raise _closed(endpoint) from error


def _closed(endpoint: str) -> PeerLostError:
    return PeerLostError(
        f"the bus at {endpoint} lets nobody in: this process may have no memory left, or may start"
        " no further threads (ulimit -v, ulimit -u)"
    )

"""The bus as a service sees it when one process plays all others: for the check of a service."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any

import zenoh

from gimpmd_coupler.bus.hub import listen
from gimpmd_coupler.bus.settings import AT_ONCE, KINDS, UNASKED, prefix

STEP_BYTES = 8
"""Length of the number of a step on the key ``again``."""


@dataclass(frozen=True)
class Heard:
    """What the rank has sent, or what has become of its token.

    Attributes
    ----------
    kind : ``register``, ``report``, ``failed``, ``data`` or ``again``, as in the key; ``alive`` or
        ``gone`` for its token.
    who : the rank in the key, ``<role>/<rank>``; of ``again`` the one that is asked.
    data : the frame.
    number : the attachment; empty without one.
    time : when it came (seconds).
    """

    kind: str
    who: str
    data: bytes
    number: bytes
    time: float


class Stage:
    """The router of a run without a coupler; made by `open_stage`.

    Attributes
    ----------
    endpoint : to which the rank connects.
    heard : what the rank has sent, in order.
    close : closes the router, as when the coupler dies.
    """

    def __init__(
        self, session: zenoh.Session, endpoint: str, start: str, close: Callable[[], None]
    ) -> None:
        self.endpoint, self.close = endpoint, close
        self.heard: SimpleQueue[Heard] = SimpleQueue()
        self._session, self._start = session, start

    def answer(self, who: str, frame: bytes, number: bytes = UNASKED) -> None:
        """Send a frame as the coupler does; without a number it answers no request."""
        self._put(f"answer/{who}", frame, attachment=number)

    def send(self, who: str, frame: bytes) -> None:
        """Send a frame as the payload of another rank."""
        self._put(f"data/{who}", frame)

    def ask_again(self, who: str, step: int) -> None:
        """Ask a rank for the payload of a step once more."""
        self._put(f"again/{who}", step.to_bytes(STEP_BYTES, "little"))

    def _put(self, key: str, frame: bytes, **more: Any) -> None:
        self._session.put(f"{self._start}/{key}", frame, **AT_ONCE, **more)

    def take(self, sample: Any) -> None:
        """Note a frame; called in the thread of the bus."""
        *_, kind, role, rank = str(sample.key_expr).split("/")
        number = b"" if sample.attachment is None else sample.attachment.to_bytes()
        self._note(kind, f"{role}/{rank}", sample.payload.to_bytes(), number)

    def take_token(self, sample: Any) -> None:
        """Note that a token came or went; called in the thread of the bus."""
        *_, role, rank = str(sample.key_expr).split("/")
        alive = sample.kind == zenoh.SampleKind.PUT
        self._note("alive" if alive else "gone", f"{role}/{rank}", b"", b"")

    def _note(self, kind: str, who: str, data: bytes, number: bytes) -> None:
        self.heard.put(Heard(kind, who, data, number, time.monotonic()))


@contextmanager
def open_stage(run: str, ranks: Sequence[str], peers: Sequence[str]) -> Iterator[Stage]:
    """Open the router of a run, on a Unix socket in a new folder.

    Parameters
    ----------
    run : str
        The run id.
    ranks, peers : sequence of str
        The ranks that are checked, and those that are played, each as ``<role>/<rank>``.
    """
    start = prefix(run)
    with ExitStack() as resources:
        session, endpoint = resources.enter_context(listen())
        stage = Stage(session, endpoint, start, resources.close)
        keys = [f"{kind}/*/*" for kind in KINDS]
        keys += [f"data/{rank}" for rank in ranks] + [f"again/{peer}" for peer in peers]
        for key in keys:
            resources.enter_context(session.declare_subscriber(f"{start}/{key}", stage.take))
        resources.enter_context(
            session.liveliness().declare_subscriber(
                f"{start}/alive/*/*", stage.take_token, history=True
            )
        )
        yield stage

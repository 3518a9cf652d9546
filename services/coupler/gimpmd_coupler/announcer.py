"""Events for the process that started the coupler: printed, but never waited for.

The reader may be stopped for minutes (Ctrl-Z). Nothing in the coupler may wait until it reads on:
ranks would not be answered, and a dead one would go unnoticed.
"""

from __future__ import annotations

import contextlib
import fcntl
import logging
import os
import select
import struct
import sys
import termios
import threading
import time

import msgspec

from gimpmd_schemas.wire.events import Alive, Event, Progress, Waiting

log = logging.getLogger(__name__)

BEAT_SECONDS = 0.5
"""Time between two signs of life."""

UNREAD_BYTES = 8192
"""Progress and signs of life are left out while so much is unread. A pipe of Linux holds 65536
bytes, so that the other events, which are few, always find room."""

_encoder = msgspec.json.Encoder()


def emit(event: Event) -> None:
    """Print an event as one line of JSON; at once, or not at all.

    A reader that has closed the pipe gets no more events.
    """
    out = sys.stdout.fileno()
    if isinstance(event, (Alive, Progress, Waiting)) and _unread(out) > UNREAD_BYTES:
        return
    if not select.select([], [out], [], 0.0)[1]:
        log.warning("nobody reads the events, so this one is lost: %s", event)
        return
    with contextlib.suppress(BrokenPipeError):
        os.write(out, _encoder.encode(event) + b"\n")


def start_beating() -> None:
    """Print signs of life from now on, in a thread of their own."""
    threading.Thread(target=_beat, daemon=True).start()


def _beat() -> None:
    while True:
        emit(Alive())
        time.sleep(BEAT_SECONDS)


def _unread(out: int) -> int:
    """Bytes in a pipe that its reader has not taken yet; 0 for anything else."""
    try:
        answer = fcntl.ioctl(out, termios.FIONREAD, bytes(4))
    except OSError:
        return 0
    return int(struct.unpack("i", answer)[0])

"""Pipes between the supervisor and the coupler: events come in, commands go out."""

from __future__ import annotations

import os
import selectors
import time
from collections.abc import Iterator
from contextlib import suppress

import msgspec

from gimpmd_deploy.launch.processes import Child
from gimpmd_schemas.wire.events import Event

_LONGEST = 1000
"""Characters of a reason: the pipe takes a line of this length at once."""


class CouplerPipe:
    """Pipes to the coupler: events come in, commands go out."""

    def __init__(self, child: Child) -> None:
        assert child.process.stdout is not None
        self.child = child
        self.pipe = child.process.stdout
        self.rest = b""
        self.decoder = msgspec.json.Decoder(Event)
        os.set_blocking(self.pipe.fileno(), False)
        self.selector = selectors.DefaultSelector()
        self.selector.register(self.pipe, selectors.EVENT_READ)

    def events(self, patience: float) -> Iterator[Event]:
        """Yield the events of the next ``patience`` seconds; all other output goes to the log."""
        if not self.is_open():
            time.sleep(patience)
            return
        if not self.selector.select(patience):
            return
        chunk = self.pipe.read(1 << 20)
        if chunk == b"":  # end of file: the coupler is gone
            self.selector.unregister(self.pipe)
        *lines, self.rest = (self.rest + (chunk or b"")).split(b"\n")
        for line in lines:
            try:
                yield self.decoder.decode(line)
            except msgspec.DecodeError:
                # the disk may be full and the folder deleted; the coupler says so by itself
                with suppress(OSError), self.child.service.log.open("ab") as log:
                    log.write(line + b"\n")

    def is_open(self) -> bool:
        """Whether the coupler may still send events."""
        return bool(self.selector.get_map())

    def has_events(self) -> bool:
        """Whether some have arrived."""
        return self.is_open() and bool(self.selector.select(0.0))

    def stop(self) -> None:
        """Ask the run to end at its next step."""
        self._send("stop")

    def lost(self, service: str, how: str) -> None:
        """Say that the processes of a service have ended, and how."""
        self._send(f"lost {service} {' '.join(how.split())[:_LONGEST]}")

    def _send(self, command: str) -> None:
        stdin = self.child.process.stdin
        with suppress(OSError):  # it may be gone already
            if stdin is not None:
                stdin.write(command.encode() + b"\n")
                stdin.flush()

    def close(self) -> None:
        """Close the pipes."""
        self.selector.close()
        for pipe in (self.child.process.stdin, self.pipe):
            with suppress(OSError):
                if pipe is not None:
                    pipe.close()

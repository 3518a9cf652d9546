"""Standard output and error that may go away while a command runs.

``gimpmd run CASE | head -1`` closes the pipe after one line, and a terminal may be closed: neither
is a reason to end a run. What nobody can read is dropped.
"""

from __future__ import annotations

import errno
import os
import sys
from typing import TextIO, cast

_GONE = (errno.EPIPE, errno.EIO)
"""What writing gives when the reader of a pipe is gone, or the terminal."""


def outlive_readers() -> None:
    """Let standard output and error drop what is written after their reader has gone."""
    sys.stdout, sys.stderr = (cast(TextIO, Lasting(stream)) for stream in (sys.stdout, sys.stderr))


class Lasting:
    """A text stream that does not fail when its reader has gone."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write; returns the number of characters."""
        try:
            return self._stream.write(text)
        except OSError as error:
            self._give_up(error)
            return len(text)

    def flush(self) -> None:
        """Write what is buffered."""
        try:
            self._stream.flush()
        except OSError as error:
            self._give_up(error)

    def __getattr__(self, name: str) -> object:
        return getattr(self._stream, name)

    def _give_up(self, error: OSError) -> None:
        """Lead what is buffered and all that follows to nowhere."""
        if error.errno not in _GONE:
            raise error
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._stream.fileno())
        os.close(nowhere)

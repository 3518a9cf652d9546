"""A recording: the frames that crossed the bus in a run, one after another in a file.

First comes the `Register` of each rank. The coupling steps follow in order, and each consists of

- a `Report` of each rank that has energies or findings at the step: of this step alone, and without
  timings;
- the `Payload` of each rank that offers nodes.

All are frames of the protocol (``schemas/protocol.md``). If the run failed, the last steps contain
what had been sent by then, and the `Refused` with the reason comes last. A file that was cut off
ends anywhere.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, get_args

import numpy as np

from gimpmd_schemas.arrays import Ints
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.errors import InputError, Problem, ProtocolError
from gimpmd_schemas.wire.messages import (
    Array,
    Member,
    Payload,
    Refused,
    Register,
    Report,
    StepReport,
    decode,
    read_frame,
)

RECORDING = "recording.frames"
"""Name of the file in the run folder."""

_Recorded = Register | Report | Payload | Refused


@dataclass(frozen=True)
class Entry:
    """A rank as it registered.

    Attributes
    ----------
    register : the message.
    offers, needs : ids of the nodes whose fields it sends, and of those whose fields it needs.
    """

    register: Register
    offers: Ints
    needs: Ints


@dataclass(frozen=True)
class RecordedStep:
    """What crossed the bus at a coupling step.

    Attributes
    ----------
    step : the coupling step.
    payloads : fields by name of each rank that has sent some, in the order of its ``offers``.
    reports : report of each rank that has energies or findings at this step.
    end : place in the file at which the step ends (bytes).
    """

    step: int
    payloads: Mapping[Member, Mapping[str, Array]]
    reports: Mapping[Member, StepReport]
    end: int


class Recording:
    """A recording that is read from its start to its end; made by `open_recording`.

    Attributes
    ----------
    entries : the ranks, as they registered.
    failure : why the run failed; empty if it did not, and until the end has been read.
    """

    def __init__(self, file: BinaryIO, path: Path) -> None:
        self._file, self._path = file, path
        self._place, self._step = 0, 0  # bytes read, and the step that is read
        self.entries: dict[Member, Entry] = {}
        self.failure = ""
        self._pending: tuple[_Recorded, dict[str, Array]] | None = None
        while (found := self._next()) is not None:
            message, arrays = found
            if not isinstance(message, Register):
                break
            nodes = [arrays.get(name, np.empty(0, np.int64)) for name in ("offers", "needs")]
            self.entries[message.role, message.rank] = Entry(message, nodes[0], nodes[1])
        self._pending = found

    def steps(self) -> Iterator[RecordedStep]:
        """Yield the steps in order, from 0 on; once. The last ones may lack payloads.

        Raises
        ------
        InputError
            The file is damaged.
        """
        payloads: dict[Member, dict[str, Array]] = {}
        reports: dict[Member, StepReport] = {}
        found, self._pending = self._pending, None
        while found is not None:
            message, arrays = found
            if isinstance(message, Refused):
                self.failure = message.reason
                return
            step, place = _step_of(message), self._place
            if not self._step <= step <= self._step + 1:
                raise self._damaged(f"a message of step {step}")
            if isinstance(message, Payload):
                payloads[message.role, message.rank] = arrays
            elif isinstance(message, Report):
                reports[message.role, message.rank] = message.steps[0]
            found = self._next()
            if found is None or _step_of(found[0]) != step:
                yield RecordedStep(step, payloads, reports, place)
                self._step = step + 1
                payloads, reports = {}, {}

    def senders(self, role: Role | None = None) -> set[Member]:
        """Ranks that send payloads: all, or those of a role."""
        return {
            member
            for member, entry in self.entries.items()
            if entry.offers.size and role in (None, member[0])
        }

    def _next(self) -> tuple[_Recorded, dict[str, Array]] | None:
        try:
            data = read_frame(self._file)
            if not data:
                return None
            found: tuple[_Recorded, dict[str, Array]] = decode(data, get_args(_Recorded))
        except ProtocolError as error:
            raise self._damaged(str(error)) from None
        self._place += len(data)
        return found

    def _damaged(self, reason: str) -> InputError:
        where = f"is damaged at byte {self._place}, in step {self._step}: {reason}"
        hint = "put the file back as the run wrote it"
        if self._step > 1:
            hint += f", or replay the steps before with --steps {self._step - 1}"
        return InputError(str(self._path), [Problem("recording", None, where, hint)])


def _step_of(message: _Recorded) -> int:
    """Step of a message; -1 if it belongs to none."""
    if isinstance(message, Payload):
        return message.step
    return message.steps[0].step if isinstance(message, Report) and message.steps else -1


@contextmanager
def open_recording(path: Path) -> Iterator[Recording]:
    """Open a recording to read it.

    Raises
    ------
    InputError
        The file cannot be read, or is damaged.
    """
    try:
        file = path.open("rb")
    except OSError as error:
        raise InputError(
            str(path), [Problem("recording", None, f"cannot be read: {error.strerror}")]
        ) from None
    with file:
        yield Recording(file, path)

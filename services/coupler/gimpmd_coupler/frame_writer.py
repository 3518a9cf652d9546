"""Writes the recording of a run: the frames that cross the bus (`gimpmd_schemas.wire.recording`).

Payloads come in a thread of the bus, and reports from the coupler. A step is written when all of it
has come. The file on disk changes with each flush only, so a full disk cannot damage it.
"""

from __future__ import annotations

import io
import logging
import threading
import time
from collections.abc import Mapping
from pathlib import Path

from gimpmd_coupler.grants import name
from gimpmd_coupler.recorder import FLUSH_SECONDS
from gimpmd_schemas.checkpoint.files import cut_file
from gimpmd_schemas.errors import InputError, Problem, ProtocolError, StorageError
from gimpmd_schemas.held_file import HeldFile
from gimpmd_schemas.wire.messages import Member, Payload, Report, StepReport, decode, encode
from gimpmd_schemas.wire.recording import open_recording

log = logging.getLogger(__name__)

FLUSH_BYTES = 2**24
"""What is held in memory at most before a flush, bytes."""

LOST_SECONDS = 5.0
"""Time after which a payload counts as lost that no rank misses."""


class FrameWriter:
    """Writes the recording.

    Parameters
    ----------
    path : Path
    first : int
        First step of the run. From a later one than 0 the recording that is there goes on.

    Raises
    ------
    InputError
        The recording ends before the first step.
    StorageError
        There is no space, or the file was deleted; also raised by ``add``, ``flush`` and ``close``.
    """

    def __init__(self, path: Path, first: int = 0) -> None:
        self._path, self._next = path, first  # next step to write
        self._lock = threading.Lock()  # guards the payloads
        self._payloads: dict[int, dict[Member, bytes]] = {}  # by step
        self._senders: frozenset[Member] = frozenset()
        self._missing_since = 0.0
        self._ended = False  # the rest of the run is not recorded
        self._failed = False  # nothing can be written any more
        self._refusal = b""  # of a run that failed
        self._flush_at, self._unwritten = 0.0, 0
        if first:
            cut_file(path, _place_of(path, first))
        self._held = HeldFile(path, "r+" if first else "w")
        self._held.seek(0, io.SEEK_END)

    def begin(self, registers: Mapping[Member, bytes], senders: frozenset[Member]) -> None:
        """Note who takes part, before the first step.

        Parameters
        ----------
        registers : mapping
            Frame with the registration of each rank.
        senders : frozenset
            Ranks that send payloads.
        """
        self._senders = senders
        if self._next == 0:
            self._write(b"".join(registers.values()))
            self.flush()

    def take(self, role: str, rank: str, data: bytes) -> None:
        """Keep a payload; called in a thread of the bus.

        One that came before changes nothing, and neither does what is no payload of this rank.
        """
        try:
            message, _ = decode(data, Payload)
        except ProtocolError:
            return
        if (message.role, str(message.rank)) != (role, rank) or message.step < self._next:
            return
        with self._lock:
            self._payloads.setdefault(message.step, {}).setdefault(
                (message.role, message.rank), data
            )

    def is_whole(self, step: int, now: float) -> bool:
        """Whether all payloads of the next step have come.

        They come before the reports, but in another thread. A rank that nobody waits for may lose
        one: then the recording ends.
        """
        with self._lock:
            missing = self._senders - self._payloads.get(step, {}).keys()
        if self._ended or not missing:
            self._missing_since = 0.0
            return True
        self._missing_since = self._missing_since or now
        if now < self._missing_since + LOST_SECONDS:
            return False
        names = ", ".join(map(name, sorted(missing)))
        log.warning("the recording ends before step %d: the payload of %s was lost", step, names)
        self._ended = True
        return True

    def add(self, step: int, reports: Mapping[Member, StepReport]) -> None:
        """Add a step of which all payloads have come."""
        with self._lock:
            payloads = self._payloads.pop(step, {})
            self._next = step + 1
        if self._ended:
            return
        told = [
            _report(member, report)
            for member, report in reports.items()
            if report.energies is not None or report.findings
        ]
        self._write(b"".join([*told, *(payloads[member] for member in sorted(payloads))]))
        if self._unwritten > FLUSH_BYTES or time.monotonic() > self._flush_at:
            self.flush()

    def note_failure(self, refusal: bytes) -> None:
        """Note with which frame all ranks were refused when the run failed."""
        self._refusal = refusal

    def flush(self) -> None:
        """Bring all steps so far to the disk."""
        self._unwritten = 0
        try:
            self._held.commit()
        except StorageError:
            self._failed = True
            raise
        self._flush_at = time.monotonic() + FLUSH_SECONDS

    def close(self) -> None:
        """Write what is left, and close the file.

        Of a run that failed, this includes what had been sent of steps that were not completed: so
        a replay comes to the failure.
        """
        try:
            if not self._failed:
                self._write_rest()
                self.flush()
        finally:
            self._held.close()

    def _write_rest(self) -> None:
        with self._lock:
            while not self._ended and (payloads := self._payloads.pop(self._next, None)):
                self._write(b"".join(payloads[member] for member in sorted(payloads)))
                self._next += 1
        self._write(self._refusal)

    def _write(self, data: bytes) -> None:
        self._held.write(memoryview(data))
        self._unwritten += len(data)


def _report(member: Member, report: StepReport) -> bytes:
    """Frame with what a rank has found at a step."""
    role, rank = member
    step = StepReport(
        step=report.step, energies=report.energies, timings={}, findings=report.findings
    )
    return encode(Report(role=role, rank=rank, steps=(step,), peak_memory=0))


def _place_of(path: Path, first: int) -> int:
    """Place in a recording at which a step begins.

    Raises
    ------
    InputError
        The recording ends before it.
    """
    last = -1
    with open_recording(path) as recording:
        senders = recording.senders()
        for one in recording.steps():
            if one.payloads.keys() != senders:
                break
            last = one.step
            if last == first - 1:
                return one.end
    raise InputError(
        str(path),
        [
            Problem(
                "recording",
                None,
                f"ends with step {last}, but the run goes on from step {first}",
                "put the file back as the run wrote it",
            )
        ],
    )

"""One rank of a side that is played back from a recording, as a `Side` of the loop."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from gimpmd_coupler.loop import Timings
from gimpmd_coupler.mapping import Link, links
from gimpmd_coupler.participant import OFFSET, OTHER
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.errors import GimpmdError
from gimpmd_schemas.wire.energies import Energies
from gimpmd_schemas.wire.findings import Finding
from gimpmd_schemas.wire.messages import Array
from gimpmd_schemas.wire.recording import RecordedStep, Recording
from gimpmd_schemas.wire.replay import Compared, Difference, Replay, keep_larger


class Playback:
    """Sends what a rank sent in a recorded run, and compares what it gets with what it got then.

    Parameters
    ----------
    recording : Recording
        Opened; it is read step by step.
    rank : int
    settings : Replay
    stop : callable
        Called after a difference that is not accepted.

    Attributes
    ----------
    offers, needs, notes : as the rank registered.
    timings : empty.
    """

    def __init__(
        self, recording: Recording, rank: int, settings: Replay, stop: Callable[[], None]
    ) -> None:
        self._role: Role = settings.side
        self._settings, self._stop = settings, stop
        self._member = (self._role, rank)
        entry = recording.entries[self._member]
        self.offers, self.needs = entry.offers, entry.needs
        self.notes = entry.register.notes
        self.timings = Timings()
        other = OTHER[self._role]
        offers = {
            number: one.offers for (role, number), one in recording.entries.items() if role == other
        }
        who = f"{self._role}/{rank}"
        self._links: dict[int, Link] = links(who, self.needs, offers, other)
        self._recording, self._steps = recording, recording.steps()
        self._fields: Mapping[str, Floats] = {}
        self._now: RecordedStep | None = None
        self._next = next(self._steps, None)
        self._payloads = self._differing = 0
        self._first: Difference | None = None
        self._largest: dict[str, Difference] = {}

    def compared(self) -> Compared:
        """What has been compared so far."""
        return Compared(
            payloads=self._payloads,
            differing=self._differing,
            first=self._first,
            largest=self._largest,
        )

    # What the loop calls

    def zone_fields(self) -> Mapping[str, Floats]:
        """The recorded fields of the next step.

        A replay of a run that failed has one more step, which the other side takes to the place of
        the failure. There the last fields are sent once more.

        Raises
        ------
        GimpmdError
            The recording has no more.
        """
        self._now, self._next = self._next, next(self._steps, None)
        payloads = {} if self._now is None else self._now.payloads
        if self._member in payloads:
            self._fields = payloads[self._member]
        elif self._now is None and not self._recording.failure:
            raise GimpmdError("the recording ends before the replay does")
        return self._fields

    def finish(self) -> None:
        """Nothing is left to do."""

    def write(self, time: float) -> None:
        """There is no output."""

    def receive(self, fields: Mapping[str, Floats]) -> None:
        """Compare the fields of the other side with the recorded ones."""
        recorded = self._next if OFFSET[self._role] else self._now
        if not fields or recorded is None:
            return
        other = OTHER[self._role]
        for rank, link in self._links.items():
            if (known := recorded.payloads.get((other, rank))) is not None:
                self._compare(recorded.step, f"{other}/{rank}", link, known, fields)

    def advance(self) -> None:
        """The next `zone_fields` reads the next step."""

    def energies(self) -> Energies | None:
        """The recorded energies."""
        report = self._now and self._now.reports.get(self._member)
        return report.energies if report else None

    def findings(self) -> tuple[Finding, ...]:
        """The recorded findings."""
        report = self._now and self._now.reports.get(self._member)
        return report.findings if report else ()

    def renew(self) -> None:
        """There is no state."""

    def state(self) -> Mapping[str, Array]:
        """There is no state: a replay begins at the first step."""
        return {}

    def close(self) -> None:
        """The caller closes the recording."""

    def _compare(
        self,
        step: int,
        rank: str,
        link: Link,
        recorded: Mapping[str, Array],
        fields: Mapping[str, Floats],
    ) -> None:
        """Compare a payload, field by field."""
        self._payloads += 1
        accepted = True
        for name, came in fields.items():
            found = _difference(
                step, rank, name, recorded[name].take(link.rows, 0), came.take(link.places, 0)
            )
            if found is None:
                continue
            keep_larger(self._largest, found)
            if found.largest > self._settings.tolerance.get(name, -1.0):
                accepted = False
                self._first = self._first or found
        if not accepted:
            self._differing += 1
            if not self._settings.goes_on:
                self._stop()


def _difference(
    step: int, rank: str, field: str, recorded: Array, came: Array
) -> Difference | None:
    """Compare the bits of a field; None if they are the same."""
    if recorded.tobytes() == came.tobytes():
        return None
    other = (recorded.view(np.int64) != came.view(np.int64)).reshape(len(came), -1)
    return Difference(
        step=step,
        rank=rank,
        field=field,
        largest=float(np.abs(came - recorded).max()),
        nodes=int(other.any(axis=1).sum()),
    )

"""The coupler and the other side, as one rank of a service sees them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from queue import Empty
from typing import Any

import numpy as np

from gimpmd_coupler.bus.settings import UNASKED
from gimpmd_coupler.bus.stage import STEP_BYTES, Heard, Stage
from gimpmd_coupler.check.log import UnmetError, expect
from gimpmd_coupler.check.process import Process
from gimpmd_coupler.participant import OFFSET, OTHER
from gimpmd_schemas.arrays import Ints
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.errors import ProtocolError
from gimpmd_schemas.wire.energies import Energies
from gimpmd_schemas.wire.fields import sent_fields
from gimpmd_schemas.wire.messages import (
    Accepted,
    Array,
    Failed,
    Grant,
    Message,
    Payload,
    Refused,
    Register,
    Report,
    decode,
    encode,
)

Fields = Mapping[str, Array]
Peer = Callable[[int], Fields]
"""Gives the fields of the other side at a step, on the nodes that the service needs."""

START_FACTOR = 6.0
"""Factor of the deadline until the second payload: kernels are compiled, potentials are read."""

_POLL_SECONDS = 0.05
_BEHIND = 3  # steps for which a rank keeps its payloads after it has reported them


class Partner:
    """Speaks with one rank of a service; answers its reports while it waits for something else.

    Parameters
    ----------
    stage : Stage
    process : Process
    plan : Plan
    role : Role
        Role of the service.
    run_dir : Path
        Run folder of the service.
    deadline : float
        How long to wait for anything that the service should do (seconds).

    Attributes
    ----------
    me, peer : names of the service's rank and of the rank of the other side.
    registrations : requests to register, in order.
    needs, offers : ids of the nodes of the registration.
    alive : whether the token of the rank exists.
    frames : payloads of the rank by step, as often as they came.
    energies : what the rank has reported, by step.
    first, last, granted : first and last step of the run, and the step that is granted.
    reported : the last step that the rank has reported.
    holds : the step at which the rank stays after a recall; None before it has said so.
    waits_for : whom the rank waits for, as it said last.
    saved : digests of the saved states by step.
    asked : steps of the payloads that the rank has asked for again.
    reports : all reports, also those that came twice.
    failure : what the rank reports as the reason of its failure, or None.
    answers_reports : whether reports are answered.
    """

    def __init__(
        self,
        stage: Stage,
        process: Process,
        plan: Plan,
        role: Role,
        run_dir: Path,
        deadline: float,
    ) -> None:
        self.stage, self.process, self.plan, self.role = stage, process, plan, role
        self.run_dir, self._deadline = run_dir, deadline
        self.me, self.peer = f"{role}/0", f"{OTHER[role]}/0"
        self._scheme = plan.coupling.scheme if plan.coupling else None
        self.registrations: list[Heard] = []
        self.needs = self.offers = np.empty(0, dtype=np.int64)
        self.alive = False
        self.frames: dict[int, list[bytes]] = {}
        self.energies: dict[int, Energies] = {}
        self.first = self.last = self.granted = self.reported = -1
        self.holds: int | None = None
        self.waits_for: set[str] = set()
        self.saved: dict[int, str] = {}
        self.asked: list[int] = []
        self.reports: list[Heard] = []
        self.failure: Failed | None = None
        self.answers_reports, self._bears_failure = True, False
        self._recalled = False
        self._checkpoints: tuple[int, ...] = ()
        self._pending: bytes = b""  # number of the report that has not been answered
        self._steps = 0  # how far `play` has come

    # What the rank does

    def wait_for(self, met: Callable[[], Any], what: str, seconds: float | None = None) -> None:
        """Take what comes until a condition is met.

        Raises
        ------
        UnmetError
            It is not met in time, or the service ends first.
        """
        seconds = self._deadline if seconds is None else seconds
        until = time.monotonic() + seconds
        while not met():
            if not self._take_next() and self.process.code is not None and not met():
                raise UnmetError(what, self.process.state())
            if time.monotonic() > until:
                raise UnmetError(what, f"nothing of the kind within {seconds:g} s")

    def listen(self, seconds: float) -> None:
        """Take what comes for some time."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self._take_next()

    def wait_for_end(self, code: int, seconds: float | None = None) -> None:
        """Wait for the end of the service with an exit code.

        Raises
        ------
        UnmetError
            It does not end in time, or with another code.
        """
        self._bears_failure = True
        wanted = f"the end of the service with exit code {code}"
        self.wait_for(lambda: self.process.code is not None, wanted, seconds)
        expect(self.process.code == code, wanted, self.process.state())

    def register(self) -> tuple[Register, dict[str, Array]]:
        """Wait for the registration."""
        self.wait_for(
            lambda: self.registrations,
            f"a request Register on the key of {self.me}",
            START_FACTOR * self._deadline,
        )
        message, arrays = self._decoded(self.registrations[0].data, Register)
        self.offers, self.needs = self._ids("offers", arrays), self._ids("needs", arrays)
        return message, arrays

    def _ids(self, name: str, arrays: Mapping[str, Array]) -> Ints:
        """Ids of nodes in a registration."""
        ids = arrays.get(name, np.empty(0))
        expect(
            name in arrays and ids.dtype == np.int64 and ids.ndim == 1,
            f"an array {name!r} of int64 with one axis",
            f"{ids.dtype} of shape {ids.shape}" if name in arrays else "no such array",
        )
        size = self.plan.background_grid().size
        inside = bool(((ids >= 0) & (ids < size)).all())
        expect(inside, f"{name} with ids below {size}, the number of nodes", "others too")
        return ids

    def payload(self, step: int) -> Fields:
        """Wait for the payload of a step, and return its fields.

        Raises
        ------
        UnmetError
            It does not come, or its fields do not fit the nodes.
        """
        seconds = (START_FACTOR if step <= self.first + 1 else 1.0) * self._deadline
        self.wait_for(lambda: step in self.frames, f"the payload of step {step}", seconds)
        return self._fields(self.frames[step][0])

    # What the rank is told

    def accept(self, last: int, granted: int, first: int = 0) -> None:
        """Answer the registration."""
        self.first, self.last, self.granted, self.reported = first, last, granted, first - 1
        self._steps = first
        all_nodes = np.arange(self.needs.size, dtype=np.int64)
        arrays = {"rows_0": all_nodes, "places_0": all_nodes} if self.needs.size else {}
        message = Accepted(
            first_step=first,
            last_step=last,
            granted=granted,
            sources=(0,) if self.needs.size else (),
        )
        for request in self.registrations:  # it may have asked again
            self.stage.answer(self.me, encode(message, arrays), request.number)

    def refuse(self, reason: str, lost: str = "") -> None:
        """Refuse all requests; also tell the rank without being asked."""
        frame = encode(Refused(reason=reason, lost=lost))
        for number in {*(request.number for request in self.registrations), self._pending} - {b""}:
            self.stage.answer(self.me, frame, number)
        self.stage.answer(self.me, frame)

    def grant(self, granted: int, checkpoints: tuple[int, ...] = ()) -> None:
        """Grant steps from now on, and answer a report that waits for it."""
        self.granted, self._checkpoints = granted, checkpoints
        self._answer_report()

    def recall(self) -> None:
        """Take the grants back."""
        self._recalled = True
        self.stage.answer(self.me, encode(self._grant()), self._pending or UNASKED)
        self._pending = b""

    def end_at(self, last: int) -> None:
        """End the run at a step, after a recall."""
        self.last = self.granted = last
        self._recalled = False
        self._answer_report()

    def send(self, step: int, fields: Fields) -> bytes:
        """Send the payload of the other side at a step; returns its frame."""
        message = Payload(role=OTHER[self.role], rank=0, step=step)
        frame = encode(message, fields)
        self.stage.send(self.peer, frame)
        return frame

    def source(self, step: int) -> int:
        """Step of the payload of the other side that the rank takes at a step."""
        return step + OFFSET[self.role]

    def play(self, peer: Peer, until: int) -> None:
        """Take the rank's payloads up to a step, and send it those of the other side."""
        for step in range(self._steps, until + 1):
            self.payload(step)
            if self.source(step) <= self.last:
                self.send(self.source(step), peer(self.source(step)))
        self._steps = max(self._steps, until + 1)

    def finish(self, peer: Peer) -> None:
        """Play up to the last step, and wait for the report of it."""
        self.play(peer, self.last)
        self.wait_for(lambda: self.reported == self.last, f"the report of step {self.last}")

    # Messages

    def _take_next(self) -> bool:
        """Take one message; returns whether there was one."""
        try:
            heard = self.stage.heard.get(timeout=_POLL_SECONDS)
        except Empty:
            return False
        if heard.kind in ("alive", "gone"):
            self.alive = heard.kind == "alive"
        elif heard.kind == "register":
            self.registrations.append(heard)
        elif heard.kind == "data":
            self._take_payload(heard)
        elif heard.kind == "again":
            self.asked.append(int.from_bytes(heard.data[:STEP_BYTES], "little"))
        elif heard.kind == "report":
            self._take_report(heard)
        elif heard.kind == "failed":
            self._take_failure(heard)
        return True

    def _take_payload(self, heard: Heard) -> None:
        message, _ = self._decoded(heard.data, Payload)
        expect(
            (message.role, message.rank) == (self.role, 0),
            f"payloads of {self.me} on its key",
            f"one of {message.role}/{message.rank}",
        )
        known = max(self.frames, default=self.first - 1)
        expect(
            message.step <= known + 1,
            f"the payload of step {known + 1}",
            f"that of step {message.step}",
        )
        self.frames.setdefault(message.step, []).append(heard.data)

    def _take_report(self, heard: Heard) -> None:
        self.reports.append(heard)
        message, _ = self._decoded(heard.data, Report)
        steps = [one.step for one in message.steps]
        if not (steps and steps[-1] <= self.reported):  # it is not one that was sent again
            whole = list(range(self.reported + 1, self.reported + 1 + len(steps)))
            expect(steps == whole, f"a report of the steps {whole}", f"one of {steps}")
        for one in message.steps:
            self.reported = max(self.reported, one.step)
            if one.energies is not None:
                self.energies[one.step] = one.energies
        self.waits_for = set(message.waits_for)
        self.holds = message.holds if message.holds is not None else self.holds
        self.saved.update({one.step: one.digest for one in message.saved})
        self._pending = heard.number
        self._answer_report()

    def _take_failure(self, heard: Heard) -> None:
        self.failure, _ = self._decoded(heard.data, Failed)
        self.stage.answer(self.me, encode(Refused(reason=self.failure.message)), heard.number)
        if not self._bears_failure:
            raise UnmetError("no failure", f"the request Failed: {self.failure.message}")

    def bear_failure(self) -> None:
        """From now on the service may report a failure."""
        self._bears_failure = True

    def _answer_report(self) -> None:
        """Answer the report that waits, if the rank may advance, or if the run ends."""
        may_go = self.granted >= self.reported + 2 or self.granted == self.last
        if self._recalled:  # a report that was sent before the rank knew of it
            may_go = self.holds is None
        if self._pending and self.answers_reports and (may_go or self.reported >= self.last):
            self.stage.answer(self.me, encode(self._grant()), self._pending)
            self._pending = b""

    def _grant(self) -> Grant:
        done = self.last if self.reported >= self.last else self.reported - _BEHIND
        return Grant(
            granted=self.granted,
            last=self.last,
            done=max(done, self.first - 1),
            recall=self._recalled,
            checkpoints=self._checkpoints,
        )

    def _decoded(self, frame: bytes, kind: type[Any]) -> tuple[Any, dict[str, Array]]:
        try:
            decoded: tuple[Message, dict[str, Array]] = decode(frame, kind)
        except ProtocolError as error:
            raise UnmetError(f"a frame with a message {kind.__name__}", str(error)) from None
        return decoded

    def _fields(self, frame: bytes) -> Fields:
        """The fields of a payload of the rank; see `payload`."""
        message, arrays = self._decoded(frame, Payload)
        for field in sent_fields(self.role, self._scheme) if self._scheme else ():
            shape = (self.offers.size, *field.shape(self.plan.dim))
            array = arrays.get(field.name)
            wanted = f"{field.name!r} as float64 of shape {shape} at step {message.step}"
            expect(array is not None, wanted, f"a payload with {sorted(arrays)}")
            assert array is not None
            expect(
                array.dtype == np.float64 and array.shape == shape,
                wanted,
                f"{array.dtype} of shape {array.shape}",
            )
            expect(
                bool(np.isfinite(array).all()), f"{wanted}, finite", "numbers that are not finite"
            )
        return arrays

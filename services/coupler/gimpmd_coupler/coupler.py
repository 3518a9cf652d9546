"""The coupler: it handles events one by one and decides.

Events are requests and connections of ranks, the request to stop (from standard input or by a
signal), and the passing of time. A request is answered in the thread of the bus in which it
arrives, under a lock, because waking another thread would take longer than the answer. Work that
no rank waits for (energies, deadlines) is left to the main thread.
"""

from __future__ import annotations

import logging
import socket
import threading
import time
from collections.abc import Callable, Mapping
from queue import Empty, SimpleQueue
from typing import Any, NoReturn

import numpy as np
import psutil

from gimpmd_coupler.bus import RECONNECT_SECONDS, Request, Token
from gimpmd_coupler.ledger import Ledger
from gimpmd_coupler.losses import Losses
from gimpmd_coupler.mapping import gather
from gimpmd_coupler.memory import peak_memory
from gimpmd_coupler.patience import Patience, Stage
from gimpmd_coupler.recorder import Recorder
from gimpmd_coupler.rendezvous import SERIAL, Answer, Member, Rendezvous, Schedule, name
from gimpmd_coupler.roster import Roster
from gimpmd_schemas.arrays import Ints
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.errors import GimpmdError, PeerLostError, ProtocolError
from gimpmd_schemas.wire import broken_bonds
from gimpmd_schemas.wire.broken_bonds import BrokenBonds
from gimpmd_schemas.wire.energies import components, total
from gimpmd_schemas.wire.events import (
    DefectFound,
    Event,
    Lost,
    Progress,
    Registered,
    ServiceFailed,
    Waiting,
)
from gimpmd_schemas.wire.fields import TOTAL_FIELDS, Field, sent_fields
from gimpmd_schemas.wire.messages import (
    Accepted,
    Array,
    Exchange,
    Failed,
    Refused,
    Register,
    Reply,
    Report,
    decode,
    encode,
)

log = logging.getLogger(__name__)

FIRST_STEP = 0
START_FACTOR = 6.0
"""Factor of the deadline before the second step: kernels are compiled, potentials are read."""

_PROGRESS_SECONDS = 0.2
_RECORD_SECONDS = 0.1  # how often complete steps are recorded
_LINGER_SECONDS = 10.0


class Stop:
    """The request to end the run at the next step."""


class Coupler:
    """Brings the ranks of a run together, step by step, until the end.

    Parameters
    ----------
    run : str
        Run id.
    plan : Plan
    emit : callable
        Called with each event for the process that started the coupler.
    recorder : Recorder
    deadline : float
        Base deadline (seconds). After this time without progress the coupler reports which ranks
        it waits for. After 3 times as long it logs what it knows about them. After 10 times as
        long it ends the run.
    """

    def __init__(
        self,
        run: str,
        plan: Plan,
        emit: Callable[[Event], None],
        recorder: Recorder,
        deadline: float,
    ) -> None:
        self._plan, self._emit, self._recorder = plan, emit, recorder
        self._lock = threading.RLock()
        # for the main thread: `Stop`, errors that end the run, and None for "look again"
        self._notes: SimpleQueue[Stop | Exception | None] = SimpleQueue()
        self._base = deadline
        self._roster = Roster(run, plan)
        self._schedule: Schedule = dict.fromkeys(plan.roles) if plan.only else SERIAL
        self._zone_fields: dict[Role, tuple[Field, ...]] = {
            role: sent_fields(role, plan.coupling.scheme) if plan.coupling else ()
            for role in plan.roles
        }
        self._rendezvous: Rendezvous[Mapping[str, Array]] = Rendezvous(
            self._roster.ranks, self._schedule, FIRST_STEP, plan.steps
        )
        self._maps: dict[Member, Ints] | None = None
        self._pending: dict[Member, Request] = {}  # last request of each rank, until answered
        self._connected: set[Member] = set()
        self._processes: dict[Member, psutil.Process] = {}
        self._losses = Losses(self._is_running, RECONNECT_SECONDS)
        self._patience = Patience(START_FACTOR * deadline, time.monotonic())
        self._ledger = Ledger()
        self._reports: dict[Member, dict[int, Report]] = {m: {} for m in self._roster.expected}
        self._recorded = FIRST_STEP - 1  # last step in the ledger
        self._defect = ""  # the warning, once a defect has been found
        self._refusal = b""  # answer to every request once the run cannot go on
        self._step = FIRST_STEP - 1  # last step with the parts of all ranks
        self._progress_at = 0.0  # when progress was last emitted

    def run(self) -> None:
        """Serve until all ranks have been told to stop.

        Raises
        ------
        PeerLostError, ProtocolError
            The run cannot go on. Waiting ranks have been answered and the event is emitted.
        """
        while self._recorded < self._rendezvous.last:
            now = time.monotonic()
            dues = (self._patience.next_due(), self._losses.next_due(now), now + _RECORD_SECONDS)
            self._process_note(min(dues))
            with self._lock:
                complete = self._complete_reports()
            for reports in complete:
                self._record(reports)
            with self._lock:
                self._watch(time.monotonic())

    def stop(self) -> None:
        """Request the end of the run at the next step; safe in signal handlers and threads."""
        self._notes.put(Stop())

    def take(self, event: Request | Token) -> None:
        """Handle an event in the thread of the bus. An error is raised in the main thread."""
        try:
            with self._lock:
                self._handle(event)
        except Exception as error:
            self._notes.put(error)

    def stopped_early(self) -> bool:
        """Whether the run ended before its end time."""
        return self._rendezvous.last < self._plan.steps

    def defect(self) -> str:
        """Return what to tell the user if a defect ended the run, else an empty text."""
        return self._defect if self._stops_at_defects() and self.stopped_early() else ""

    def position(self) -> tuple[int, float]:
        """Return the last step for which all ranks have sent their parts, and its time."""
        return self._step, max(self._step, FIRST_STEP) * self._plan.step

    def refuse_all(self, reason: str, lost: str) -> None:
        """Refuse all requests, those that wait and those to come: the run cannot go on."""
        with self._lock:
            self._refusal = encode(Refused(reason=reason, lost=lost))
            for request in self._pending.values():
                request.answer(self._refusal)
            self._pending.clear()

    def linger(self) -> None:
        """Stay until all ranks have left, but not longer than `_LINGER_SECONDS`.

        Repeated requests are answered again. After a loss, a rank that is computing learns of it
        only at its next exchange.

        Raises
        ------
        PeerLostError
            A service reports that it failed after the last step.
        """
        deadline = time.monotonic() + _LINGER_SECONDS
        while self._connected and time.monotonic() < deadline:
            self._process_note(deadline)

    # Events

    def _process_note(self, until: float) -> None:
        """Wait for a note to the main thread, at most until a time, and process it."""
        try:
            note = self._notes.get(timeout=max(until - time.monotonic(), 0.0))
        except Empty:
            return
        if isinstance(note, Exception):
            raise note
        if isinstance(note, Stop):
            log.info("asked to stop")
            with self._lock:
                self._answer(self._rendezvous.stop())

    def _handle(self, event: Any) -> None:
        if isinstance(event, Request) and self._refusal:
            event.answer(self._refusal)
        elif isinstance(event, Request):
            try:
                self._on_request(event)
            except ProtocolError as error:
                log.warning("refused %s of %s/%s: %s", event.kind, event.role, event.rank, error)
                event.answer(encode(Refused(reason=str(error))))
        elif isinstance(event, Token):
            self._on_token(event)

    def _on_request(self, request: Request) -> None:
        decoded: tuple[Register | Exchange | Report | Failed, dict[str, Array]] = decode(
            request.data, (Register, Exchange, Report, Failed)
        )
        message, arrays = decoded
        if (request.role, request.rank) != (message.role, str(message.rank)):
            raise ProtocolError(
                f"a message of {message.role}/{message.rank} arrived on the key of"
                f" {request.role}/{request.rank}"
            )
        if isinstance(message, Register):
            self._on_register(request, message, arrays)
        elif isinstance(message, Exchange):
            self._on_exchange(request, message, arrays)
        elif isinstance(message, Report):
            self._on_report(request, message)
        else:
            self._on_failed(request, message)

    def _on_register(
        self, request: Request, message: Register, arrays: Mapping[str, Array]
    ) -> None:
        known = set(self._roster.entries)
        member = self._roster.enter(message, arrays)
        self._pending[member] = request
        if member not in known:
            self._look_up(member, message)
            self._patience.restart(START_FACTOR * self._base, time.monotonic())
            log.info("%s registered: %s, process %d", name(member), message.backend, message.pid)
            self._emit(Registered(name(member)))
            self._recorder.note(message.notes)
        if not self._roster.missing():
            self._accept()

    def _accept(self) -> None:
        """Answer all registrations: every rank has registered."""
        if self._maps is None:
            try:
                self._maps = self._roster.maps(self._schedule)
            except ProtocolError as error:
                # as another kind of error: a ProtocolError would only refuse the rank that asked
                reason = str(error)
                self._end(PeerLostError(reason), ServiceFailed("coupler", reason, error.exit_code))
        accepted = encode(Accepted(first_step=FIRST_STEP, last_step=self._rendezvous.last))
        for member in [m for m, request in self._pending.items() if request.kind == "register"]:
            self._pending.pop(member).answer(accepted)

    def _on_exchange(
        self, request: Request, message: Exchange, arrays: Mapping[str, Array]
    ) -> None:
        member = self._roster.refuse_stranger(message)
        if self._maps is None:
            raise ProtocolError(f"{name(member)} exchanges before all ranks have registered")
        self._check_part(member, message, arrays)
        self._rendezvous.check(member, message.step)
        if message.report is not None:
            self._keep_report(member, message.report, message.step - 1)
            if self._stops_at_defects() and _tells_of_defect(message.report):
                # before the part is taken: all ranks then stop at this step, whatever their order
                self._answer(self._rendezvous.stop())
        elif message.step > FIRST_STEP:
            raise ProtocolError(f"{name(member)} sends no report of step {message.step - 1}")
        answers = self._rendezvous.submit(member, message.step, arrays)
        self._pending[member] = request
        self._answer(answers)
        while self._step < self._rendezvous.last and self._rendezvous.is_complete(self._step + 1):
            self._step += 1

    def _on_report(self, request: Request, message: Report) -> None:
        """Take the last report of a rank, which is sent by itself."""
        member: Member = (message.role, message.rank)
        if member not in self._roster.entries:
            raise ProtocolError(f"{name(member)} does not take part in this run")
        self._keep_report(member, message, self._rendezvous.last)
        request.answer(encode(Reply(step=message.step, directive="stop")))
        self._notes.put(None)

    def _on_failed(self, request: Request, message: Failed) -> None:
        member: Member = (message.role, message.rank)
        if member not in self._roster.expected:
            raise ProtocolError(f"{name(member)} does not take part in this run")
        self._pending[member] = request
        dead = self._losses.first_dead()
        if dead is not None and dead != member:  # a victim: its own message would mislead
            log.info("%s failed after %s was lost: %s", name(member), name(dead), message.message)
            self._lose(dead)
        self._end(
            PeerLostError(f"{name(member)} failed: {message.message}"),
            ServiceFailed(name(member), message.message, message.exit_code),
        )

    def _on_token(self, token: Token) -> None:
        now = time.monotonic()
        members = [m for m in self._roster.expected if name(m) == f"{token.role}/{token.rank}"]
        for member in members:
            if token.alive:
                self._connected.add(member)
                self._losses.up(member)
            else:
                self._connected.discard(member)
                if member in self._roster.entries and not self._is_done(member):
                    self._losses.down(member, now)
                self._notes.put(None)

    # Decisions

    def _answer(self, answers: list[Answer]) -> None:
        for answer in answers:
            if (request := self._pending.pop(answer.member, None)) is not None:
                reply = Reply(step=answer.step, directive=answer.directive)
                request.answer(encode(reply, self._fields(answer)))
        if answers:
            early = self._step <= FIRST_STEP
            self._patience.restart((START_FACTOR if early else 1.0) * self._base, time.monotonic())

    def _fields(self, answer: Answer) -> dict[str, Array]:
        """Return the fields of an answer, on the nodes that the rank needs."""
        if answer.source is None or self._maps is None:
            return {}
        parts = self._rendezvous.parts(*answer.source)
        index = self._maps[answer.member]
        return {
            field.name: gather(parts, field.name, index)
            for field in self._zone_fields[answer.source[0]]
        }

    def _check_part(self, member: Member, message: Exchange, arrays: Mapping[str, Array]) -> None:
        """Check that a part fits the coupling scheme and the registration of its rank.

        Raises
        ------
        ProtocolError
            A field is missing, has the wrong shape, or is not finite.
        """
        count = len(self._roster.entries[member].offers)
        for field in self._zone_fields[member[0]]:
            shape = (count, *field.shape(self._plan.dim))
            array = arrays.get(field.name)
            if array is None:
                raise ProtocolError(f"{name(member)} sends no field {field.name!r}")
            if array.shape != shape or array.dtype != np.float64:
                raise ProtocolError(
                    f"{name(member)} sends {field.name!r} as {array.dtype} of shape"
                    f" {array.shape}; for its offers it must be float64 of shape {shape}"
                )
            if not np.isfinite(array).all():
                raise ProtocolError(
                    f"{name(member)} sends {field.name!r} that is not finite at step"
                    f" {message.step}: its solution has blown up; try a smaller time step"
                )

    # Reports

    def _keep_report(self, member: Member, report: Report, step: int) -> None:
        """Keep a report until the reports of all ranks are there; a repeated one changes nothing.

        Raises
        ------
        ProtocolError
            It belongs to another step or rank, or its momentum has the wrong number of components.
        """
        if (report.role, report.rank, report.step) != (*member, step):
            raise ProtocolError(
                f"{name(member)} sends the report of {report.role}/{report.rank} at step"
                f" {report.step}; it must be its own report of step {step}"
            )
        dim = self._plan.dim
        if report.energies is not None and len(report.energies.momentum) != dim:
            raise ProtocolError(
                f"{name(member)} reports a momentum with {len(report.energies.momentum)}"
                f" components; the run has {dim} dimensions"
            )
        if step > self._recorded:
            self._reports[member].setdefault(step, report)

    def _is_done(self, member: Member) -> bool:
        """Whether a rank has been told to stop and has sent its last report."""
        last = self._rendezvous.last
        return last in self._reports[member] or self._recorded == last

    def _complete_reports(self) -> list[dict[Member, Report]]:
        """Take out the reports of all steps for which no report is missing, in order."""
        complete = []
        while all(self._recorded + 1 in reports for reports in self._reports.values()):
            self._recorded += 1
            complete.append({m: kept.pop(self._recorded) for m, kept in self._reports.items()})
        return complete

    def _record(self, reports: Mapping[Member, Report]) -> None:
        """Add one step to the ledger and to the record of the run."""
        sides = {
            role: total([reports[role, rank].energies for rank in range(ranks)])
            for role, ranks in self._roster.ranks.items()
        }
        whole = self._ledger.add(sides.values())
        step = next(iter(reports.values())).step
        now = step * self._plan.step
        row: dict[str, float] = {"/series/step": step, "/series/time": now}
        row |= {f"/series/total/{field.name}": getattr(whole, field.name) for field in TOTAL_FIELDS}
        for role, side in sides.items():
            for quantity, value in components(side, self._plan.dim).items():
                row[f"/series/{role}/{quantity}"] = value
        bonds = broken_bonds.total([report.broken_bonds for report in reports.values()])
        if bonds is not None:
            for quantity, value in broken_bonds.components(bonds, self._plan.dim).items():
                row[f"/series/md/{quantity}"] = value
            self._warn_of_defect(bonds, step, now)
        row["/memory/coupler/0"] = peak_memory()
        for member, report in reports.items():
            where = name(member)
            row[f"/memory/{where}"] = report.peak_memory
            for phase, seconds in report.timings.items():
                row[f"/timings/{where}/{phase}"] = seconds
        self._recorder.add(row)
        self._show_progress(step, now)

    def _stops_at_defects(self) -> bool:
        return self._plan.coupling is not None and self._plan.coupling.on_defect == "stop"

    def _warn_of_defect(self, bonds: BrokenBonds, step: int, now: float) -> None:
        """Say once that a defect has reached the planes."""
        if bonds.place is None or self._defect:
            return
        self._defect = broken_bonds.warning(now, bonds.place)
        log.warning("%s", self._defect)
        self._emit(DefectFound(step, self._defect))

    def _show_progress(self, step: int, now: float) -> None:
        clock = time.monotonic()
        if clock - self._progress_at >= _PROGRESS_SECONDS or step == self._rendezvous.last:
            self._progress_at = clock
            self._emit(Progress(step, self._plan.steps, now))

    # Time

    def _watch(self, now: float) -> None:
        """Check whether a rank is lost or has been silent for too long."""
        if self._recorded == self._rendezvous.last:
            return
        if (member := self._losses.culprit(now)) is not None:
            self._lose(member)
        if (stage := self._patience.due(now)) is None:
            return
        silent = (
            self._roster.missing()
            or self._rendezvous.awaited()
            or [member for member in self._roster.expected if not self._is_done(member)]
        )
        names, seconds = tuple(map(name, silent)), self._patience.waited(now)
        log.info("waiting for %s, %.1f s so far", ", ".join(names), seconds)
        if stage is Stage.SAY:
            self._emit(Waiting(names, seconds))
        elif stage is Stage.DIAGNOSE:
            self._emit(Waiting(names, seconds))
            for member in silent:
                log.info("%s: %s", name(member), self._state(member))
        else:
            why = f"silent for {seconds:.1f} s; {self._state(silent[0])}"
            self._lose(silent[0], why)

    def _lose(self, member: Member, why: str = "") -> NoReturn:
        """End the run because a rank is lost."""
        why = why or f"its connection is down and {self._state(member)}"
        step = self._step + 1
        self._end(
            PeerLostError(f"{name(member)} was lost at step {step}: {why}"),
            Lost(name(member), step, why),
        )

    def _end(self, error: GimpmdError, event: Lost | ServiceFailed) -> NoReturn:
        """End the run: refuse all requests, emit the event and raise the error."""
        self.refuse_all(str(error), event.who)
        self._emit(event)
        raise error

    # Processes

    def _look_up(self, member: Member, register: Register) -> None:
        """Remember the process of a rank if it runs on this machine."""
        if register.host == socket.gethostname() and psutil.pid_exists(register.pid):
            self._processes[member] = psutil.Process(register.pid)

    def _is_running(self, member: Member) -> bool:
        process = self._processes.get(member)
        if process is None:
            return True
        try:
            return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
        except psutil.NoSuchProcess:
            return False

    def _state(self, member: Member) -> str:
        """Describe what is known about the process of a rank."""
        process = self._processes.get(member)
        if process is None:
            return "it has not registered" if member in self._roster.missing() else "it is remote"
        if not self._is_running(member):
            return f"its process {process.pid} is gone"
        return f"its process {process.pid} is {process.status()}"


def _tells_of_defect(report: Report) -> bool:
    """Whether bonds near the planes of a rank are broken."""
    return report.broken_bonds is not None and report.broken_bonds.count > 0

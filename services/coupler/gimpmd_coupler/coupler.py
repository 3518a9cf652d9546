"""The coupler: it handles events one by one and decides.

Events are requests and connections of ranks, the request to stop (from standard input or by a
signal), and the passing of time. Requests are handled in the thread of the bus in which they
arrive, under a lock. Work that no rank waits for (energies, deadlines) is left to the main thread.

Payloads of a step do not come here: ranks send them to each other. The coupler sees registrations,
reports of completed steps, failures, and who is connected.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any, NoReturn

from gimpmd_coupler.books import Books
from gimpmd_coupler.bus.hub import Request, Token
from gimpmd_coupler.bus.settings import RECONNECT_SECONDS
from gimpmd_coupler.checkpoints import Checkpoints
from gimpmd_coupler.frame_writer import FrameWriter
from gimpmd_coupler.grants import FEWEST, Grants, name
from gimpmd_coupler.losses import Losses
from gimpmd_coupler.patience import Patience, Stage
from gimpmd_coupler.processes import Processes
from gimpmd_coupler.recorder import Recorder
from gimpmd_coupler.roster import Roster
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.checkpoint.manifest import Manifest
from gimpmd_schemas.errors import GimpmdError, PeerLostError, ProtocolError
from gimpmd_schemas.wire.events import (
    Checkpointed,
    Event,
    Lost,
    Progress,
    Registered,
    ServiceFailed,
    Waiting,
)
from gimpmd_schemas.wire.messages import (
    Accepted,
    Array,
    Failed,
    Member,
    Refused,
    Register,
    Report,
    decode,
    encode,
)

log = logging.getLogger(__name__)

START_FACTOR = 6.0
"""Factor of the deadline before the second step: kernels are compiled, potentials are read."""

_PROGRESS_SECONDS = 0.2
_RECORD_SECONDS = 0.1  # how often complete steps are recorded
_LINGER_SECONDS = 10.0
_SETTLE_SECONDS = 0.5  # in which a rank that is not kept waiting says where it stays
_WORD_SECONDS = 1.0
"""Time in which the coupler itself may find out which rank of a lost service died, or that the run
has come to its end."""


class Stop:
    """The request to end the run."""


@dataclass(frozen=True)
class ServiceLost:
    """Word that all processes of a service have ended: which service, and how."""

    service: str
    reason: str


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
    checkpoints : Checkpoints
    deadline : float
        Base deadline (seconds). After this time without progress the coupler reports which ranks
        it waits for. After 3 times as long it logs what it knows about them. After 10 times as
        long it ends the run. Infinite: it waits as long as the processes of all ranks live, also
        if their connections are down, as those of a process in a debugger are.
    start : Manifest, optional
        The checkpoint from which the run goes on.
    frames : FrameWriter, optional
        Writes the recording of a run that is recorded.
    """

    def __init__(
        self,
        run: str,
        plan: Plan,
        emit: Callable[[Event], None],
        recorder: Recorder,
        checkpoints: Checkpoints,
        deadline: float,
        start: Manifest | None = None,
        frames: FrameWriter | None = None,
    ) -> None:
        self._frames = frames
        self._plan, self._emit, self._recorder = plan, emit, recorder
        self._checkpoints = checkpoints
        self._first = 0 if start is None else start.step
        self._lock = threading.RLock()
        # for the main thread: what others ask or say, errors that end the run, and None for
        # "look again"
        self._notes: SimpleQueue[Stop | ServiceLost | Exception | None] = SimpleQueue()
        self._service_lost: ServiceLost | None = None
        self._service_lost_due = float("inf")  # when the run ends because of it
        self._base = deadline
        self._roster = Roster(run, plan, self._first)
        self._books = Books(plan, self._roster, emit, recorder, start, frames)
        self._stops_at_defects = plan.coupling is not None and plan.coupling.on_defect == "stop"
        reach = FEWEST if self._stops_at_defects else None
        self._grants = Grants(
            self._roster.expected,
            self._first,
            plan.steps,
            time.monotonic(),
            reach,
            plan.steps_together,
            plan.checkpoint is not None,
        )
        self._registered: dict[Member, bytes] = {}  # registrations
        self._accepted: dict[Member, bytes] = {}  # answers to them
        self._reach: dict[Member, Request] = {}  # a request of each rank, to tell it something
        self._waits_for: dict[Member, tuple[str, ...]] = {}
        self._pending: dict[Member, Request] = {}  # last request of each rank, until answered
        self._connected: set[Member] = set()
        self._processes = Processes()
        reconnect = RECONNECT_SECONDS if math.isfinite(deadline) else math.inf
        self._losses = Losses(self._processes.is_running, reconnect)
        self._patience = Patience(START_FACTOR * deadline, time.monotonic())
        self._refusal = b""  # answer to every request once the run cannot go on
        self._progress_at = 0.0  # when progress was last emitted
        self._asked_to_stop = False  # by a rank
        self._settle_due = 0.0  # when a recall has taken too long
        self._cancelled = False  # asked to stop before all ranks had registered

    def run(self) -> None:
        """Serve until all ranks have been told to stop.

        Raises
        ------
        PeerLostError, ProtocolError
            The run cannot go on. Waiting ranks have been answered and the event is emitted.
        """
        while self._books.recorded < self._grants.last and not self._cancelled:
            now = time.monotonic()
            dues = (self._patience.next_due(), self._losses.next_due(now), now + _RECORD_SECONDS)
            self._process_note(min(*dues, self._service_lost_due))
            with self._lock:
                page = self._books.take_complete()
            if page.steps:
                self._books.record(page)
            for step in page.steps:
                self._show_progress(step)
            self._keep()
            with self._lock:
                self._settle(time.monotonic())
                self._watch(time.monotonic())

    def stop(self) -> None:
        """Request the end of the run; safe in signal handlers and threads."""
        self._notes.put(Stop())

    def lost(self, service: str, reason: str) -> None:
        """Take word that the processes of a service have ended; safe in threads.

        It is needed for ranks that die before they have registered.
        """
        self._notes.put(ServiceLost(service, reason))

    def take(self, event: Request | Token) -> None:
        """Handle an event in the thread of the bus. An error is raised in the main thread."""
        try:
            with self._lock:
                self._handle(event)
        except Exception as error:
            self._notes.put(error)

    def stopped_early(self) -> bool:
        """Whether the run ended before its end time."""
        return self._cancelled or self._grants.last < self._plan.steps

    def defect(self) -> str:
        """Return what to tell the user if a finding ended the run, else an empty text."""
        return self._books.defect if self._stops_at_defects and self.stopped_early() else ""

    def position(self) -> tuple[int, float]:
        """Return the last step that all ranks have completed, and its time."""
        done = max(self._grants.done, self._first)
        return done, done * self._plan.step

    def refuse_all(self, reason: str, lost: str) -> None:
        """Refuse all requests, those that wait and those to come: the run cannot go on."""
        with self._lock:
            self._refusal = encode(Refused(reason=reason, lost=lost))
            if self._frames is not None:
                self._frames.note_failure(self._refusal)
            for request in self._pending.values():
                request.answer(self._refusal)
            self._pending.clear()
            for request in self._reach.values():  # ranks that wait for a payload
                request.tell(self._refusal)

    def linger(self) -> None:
        """Stay until all ranks have left, but not longer than `_LINGER_SECONDS`.

        Repeated requests are answered again.

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
        if isinstance(note, ServiceLost):
            self._service_lost = note
            self._service_lost_due = time.monotonic() + _WORD_SECONDS
        elif isinstance(note, Stop):
            log.info("asked to stop")
            if self._roster.missing():
                self._cancelled = True
                self.refuse_all("the run was stopped before all ranks had registered", "coupler")
                return
            with self._lock:
                self._grants.stop()
                self._settle_due = time.monotonic() + _SETTLE_SECONDS
                self._answer_reports()
                recall = encode(self._grants.grant())
                for request in self._reach.values():  # ranks that compute or wait for a payload
                    request.tell(recall)

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
        decoded: tuple[Register | Report | Failed, dict[str, Array]] = decode(
            request.data, (Register, Report, Failed)
        )
        message, arrays = decoded
        if (request.role, request.rank) != (message.role, str(message.rank)):
            raise ProtocolError(
                f"a message of {message.role}/{message.rank} arrived on the key of"
                f" {request.role}/{request.rank}"
            )
        if isinstance(message, Register):
            self._on_register(request, message, arrays)
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
            self._reach[member] = request
            self._registered[member] = request.data
            self._processes.look_up(member, message)
            self._patience.restart(START_FACTOR * self._base, time.monotonic())
            log.info("%s registered: %s, process %d", name(member), message.backend, message.pid)
            self._emit(Registered(name(member)))
            self._recorder.note(message.notes)
        if not self._roster.missing():
            self._accept()

    def _accept(self) -> None:
        """Answer all registrations: every rank has registered."""
        if not self._accepted:
            try:
                self._accepted = {m: self._acceptance(m) for m in self._roster.expected}
            except ProtocolError as error:
                # as another kind of error: a ProtocolError would only refuse the rank that asked
                reason = str(error)
                self._end(PeerLostError(reason), ServiceFailed("coupler", reason, error.exit_code))
            if self._frames is not None:
                entries = self._roster.entries
                senders = frozenset(m for m, entry in entries.items() if entry.offers.size)
                self._frames.begin({m: self._registered[m] for m in self._roster.expected}, senders)
        for member in [m for m, request in self._pending.items() if request.kind == "register"]:
            self._pending.pop(member).answer(self._accepted[member])

    def _acceptance(self, member: Member) -> bytes:
        links = self._roster.links(member)
        message = Accepted(
            first_step=self._first,
            last_step=self._grants.last,
            granted=self._grants.granted,
            sources=tuple(links),
        )
        arrays: dict[str, Array] = {}
        for rank, link in links.items():
            arrays |= {f"rows_{rank}": link.rows, f"places_{rank}": link.places}
        return encode(message, arrays)

    def _on_report(self, request: Request, message: Report) -> None:
        member = self._roster.check_report(message)
        if not self._accepted:
            raise ProtocolError(f"{name(member)} reports before all ranks have registered")
        now = time.monotonic()
        steps = [report.step for report in message.steps]
        defect = _first_defect(message) if self._stops_at_defects else None
        done = self._grants.done
        new = self._grants.report(member, steps, now, defect, message.holds)
        reports = [report for report in message.steps if report.step in new]
        self._books.enter(member, reports, message.peak_memory)
        self._look_at_body(range(done + 1, self._grants.done + 1))
        self._checkpoints.note_saved(member, message.saved)
        if message.stop and not self._asked_to_stop:
            self._asked_to_stop = True
            log.info("%s was asked to end the run", name(member))
            self.stop()
        self._waits_for[member] = message.waits_for
        self._pending[member] = request
        self._answer_reports()
        if new:
            early = self._grants.done <= self._first
            self._patience.restart((START_FACTOR if early else 1.0) * self._base, now)
        if self._grants.finished():
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
        # payloads do not pass through here, so nobody can check whom a rank blames
        others = {name(other) for other in self._roster.expected} - {name(member)}
        blames = message.culprit in others
        words = f"it says that {message.culprit} is at fault: " if blames else ""
        words += message.message
        self._end(
            PeerLostError(f"{name(member)} failed: {words}"),
            ServiceFailed(name(member), words, message.exit_code),
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

    def _answer_reports(self) -> None:
        """Answer the ranks that can go on; the others are answered when they can."""
        held = [m for m, request in self._pending.items() if request.kind == "report"]
        for member in [m for m in held if self._can_go_on(m)]:
            self._pending.pop(member).answer(encode(self._grants.grant()))

    def _can_go_on(self, member: Member) -> bool:
        """Whether an answer is of use to a rank.

        A rank that has completed the last step stays until all others have, because they may ask
        for its last payload again.
        """
        if self._is_done(member) and not self._grants.recalling:
            return self._grants.finished()
        return self._grants.may_go_on(member)

    def _is_done(self, member: Member) -> bool:
        """Whether a rank has completed the last step."""
        return self._grants.reported[member] == self._grants.last

    def _look_at_body(self, steps: range) -> None:
        """Let the monitor of the whole body look at steps that all ranks have just completed."""
        step = self._books.defect_of_body(steps)
        if step is not None and self._stops_at_defects:
            self._grants.end_after(step)

    # Complete steps

    def _keep(self) -> None:
        """Order a checkpoint when one is due, and commit those that all ranks have saved."""
        now, wanted = time.monotonic(), self._plan.checkpoint
        with self._lock:
            if wanted is not None and self._accepted and self._checkpoints.due(now):
                step = self._grants.order_checkpoint(wanted.every)
                if step is not None:
                    self._checkpoints.note_order(step, now)
            ready = self._checkpoints.ready(self._books.recorded)
        if ready:
            self._books.flush()
        for step in ready:
            self._checkpoints.commit(step, self._books.start_energy, self._recorder.path)
            self._emit(Checkpointed(step, step * self._plan.step))

    def _show_progress(self, step: int) -> None:
        now = time.monotonic()
        if now - self._progress_at >= _PROGRESS_SECONDS or step == self._grants.last:
            self._progress_at = now
            self._emit(Progress(step, self._plan.steps, step * self._plan.step))

    # Time

    def _settle(self, now: float) -> None:
        """Let ranks go on a little that stay, if others of their role wait for them."""
        if self._grants.recalling and now >= self._settle_due and self._grants.settle():
            log.info("ranks that stay go on to step %d: others wait for them", self._grants.last)
            self._answer_reports()

    def _watch(self, now: float) -> None:
        """Check whether a rank is lost or has been silent for too long."""
        if self._books.recorded == self._grants.last:
            return
        if (member := self._losses.culprit(now)) is not None:
            self._lose(member)
        if self._service_lost is not None and now >= self._service_lost_due:
            self._lose_service(self._service_lost)
        if (stage := self._patience.due(now)) is None:
            return
        silent = (
            self._roster.missing()
            or [m for m in self._behind() if not self._waits_for.get(m)]
            or self._behind()
        )
        names, seconds = tuple(map(name, silent)), self._patience.waited(now)
        log.info("waiting for %s, %.1f s so far", ", ".join(names), seconds)
        if stage is Stage.SAY:
            self._emit(Waiting(names, seconds))
        elif stage is Stage.DIAGNOSE:
            self._emit(Waiting(names, seconds))
            for member in silent:
                log.info("%s: %s", name(member), self._describe(member))
        else:
            why = f"silent for {seconds:.1f} s; {self._describe(silent[0])}"
            self._lose(silent[0], why)

    def _behind(self) -> list[Member]:
        """Ranks that are computing or wait for a payload; all others wait for a grant."""
        return [m for m in self._roster.expected if not self._is_done(m) and m not in self._pending]

    def _lose(self, member: Member, why: str = "") -> NoReturn:
        """End the run because a rank is lost."""
        why = why or f"its connection is down and {self._describe(member)}"
        step = max(self._grants.reported.values()) + 1  # that no rank has completed
        self._end(
            PeerLostError(f"{name(member)} was lost at step {step}: {why}"),
            Lost(name(member), step, why),
        )

    def _lose_service(self, lost: ServiceLost) -> NoReturn:
        """End the run because the processes of a service have ended."""
        step = max(self._grants.reported.values()) + 1
        error = PeerLostError(f"{lost.service} was lost at step {step}: {lost.reason}")
        self._end(error, Lost(lost.service, step, lost.reason))

    def _describe(self, member: Member) -> str:
        """Describe what is known about a rank."""
        if member in self._roster.missing():
            return "it has not registered"
        return self._processes.state(member)

    def _end(self, error: GimpmdError, event: Lost | ServiceFailed) -> NoReturn:
        """End the run: refuse all requests, emit the event and raise the error."""
        self.refuse_all(str(error), event.who)
        self._emit(event)
        raise error


def _first_defect(report: Report) -> int | None:
    """Return the first step at which a monitor of a rank found something."""
    return next((step.step for step in report.steps if step.findings), None)

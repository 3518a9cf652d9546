"""The coupler: one thread that takes events one by one and decides.

Events are questions and connections of ranks (from the bus), the wish to stop (from standard
input or a signal), and the passing of time.
"""

from __future__ import annotations

import logging
import socket
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any, NoReturn

import numpy as np
import psutil

from gimpmd_coupler.bus import RECONNECT_SECONDS, Request, Token
from gimpmd_coupler.ledger import QUANTITIES, Ledger
from gimpmd_coupler.losses import Losses
from gimpmd_coupler.mapping import gather
from gimpmd_coupler.memory import peak_memory
from gimpmd_coupler.patience import Patience, Stage
from gimpmd_coupler.recorder import Recorder
from gimpmd_coupler.rendezvous import SCHEDULES, Answer, Member, Rendezvous, Schedule, name
from gimpmd_coupler.roster import Roster
from gimpmd_schemas.case import Case
from gimpmd_schemas.errors import GimpmdError, PeerLostError, ProtocolError
from gimpmd_schemas.events import (
    Event,
    Lost,
    Progress,
    Registered,
    ServiceFailed,
    Waiting,
)
from gimpmd_schemas.grid import Ints
from gimpmd_schemas.messages import (
    SCHEME_FIELDS,
    Accepted,
    Array,
    Exchange,
    Failed,
    Refused,
    Register,
    Reply,
    decode,
    encode,
)

log = logging.getLogger(__name__)

FIRST_STEP = 0
START_FACTOR = 6.0
"""Before the second step is done kernels are compiled and potentials read: more patience."""

_PROGRESS_SECONDS = 0.2
_LINGER_SECONDS = 10.0
_SHAPES = {"mass": (), "momentum": (2,), "velocity": (2,), "strain": (3,), "force": (2,)}


class Stop:
    """The wish to end the run at the next step."""


@dataclass(frozen=True)
class _Part:
    """What a rank handed in at a step."""

    message: Exchange
    fields: Mapping[str, Array]


class Coupler:
    """Brings the ranks of a run together, step by step, until the end.

    Parameters
    ----------
    run : str
        Run id.
    case : Case
        The resolved case.
    events : SimpleQueue
        Where requests, tokens and `Stop` arrive.
    emit : callable
        Takes the events that the outside world is told.
    recorder : Recorder
    deadline : float
        Base deadline (seconds): without progress for so long the coupler says whom it waits for,
        after 3 times it logs what it knows of them, after 10 times it ends the run.
    """

    def __init__(
        self,
        run: str,
        case: Case,
        events: SimpleQueue[Any],
        emit: Callable[[Event], None],
        recorder: Recorder,
        deadline: float,
    ) -> None:
        self._case, self._events, self._emit, self._recorder = case, events, emit, recorder
        self._base = deadline
        self._roster = Roster(run, case)
        self._schedule: Schedule = (
            dict.fromkeys(self._roster.ranks)
            if case.only
            else SCHEDULES[case.coupling.scheme, "serial"]
        )
        self._rendezvous: Rendezvous[_Part] = Rendezvous(
            self._roster.ranks, self._schedule, FIRST_STEP, case.steps()
        )
        self._maps: dict[Member, Ints] | None = None
        self._pending: dict[Member, Request] = {}
        self._connected: set[Member] = set()
        self._processes: dict[Member, psutil.Process] = {}
        self._losses = Losses(self._is_running, RECONNECT_SECONDS)
        self._patience = Patience(START_FACTOR * deadline, time.monotonic())
        self._ledger = Ledger()
        self._refusal = b""  # what everybody is told once the run cannot go on
        self._step = FIRST_STEP - 1  # last step of which all parts are in
        self._told = 0.0  # when progress was last emitted

    def run(self) -> None:
        """Serve until all ranks have been told to stop.

        Raises
        ------
        PeerLostError, ProtocolError
            The run cannot go on; the ranks that wait, and ``emit``, have been told.
        """
        while not self._rendezvous.finished():
            now = time.monotonic()
            self._handle(self._poll(min(self._patience.next_due(), self._losses.next_due(now))))
            self._watch(time.monotonic())

    def stopped_early(self) -> bool:
        """Whether the run was ended before the end time of the case."""
        return self._rendezvous.last < self._case.steps()

    def position(self) -> tuple[int, float]:
        """Return the last step of which all parts are in, and its time."""
        return self._step, max(self._step, FIRST_STEP) * self._case.step()

    def refuse_all(self, reason: str, lost: str) -> None:
        """Answer whoever waits, and whoever asks from now on, that the run cannot go on."""
        self._refusal = encode(Refused(reason=reason, lost=lost))
        for request in self._pending.values():
            request.answer(self._refusal)
        self._pending.clear()

    def linger(self) -> None:
        """Stay until the ranks have left, or for a while.

        A repeated request is answered again; and after a loss, a rank that is at work learns of
        it at its next exchange only.

        Raises
        ------
        PeerLostError
            A service reports that it failed after the last step.
        """
        deadline = time.monotonic() + _LINGER_SECONDS
        while self._connected and time.monotonic() < deadline:
            self._handle(self._poll(deadline))

    # Events

    def _poll(self, until: float) -> Any:
        """Return the next event, or None when the time has come."""
        try:
            return self._events.get(timeout=max(until - time.monotonic(), 0.0))
        except Empty:
            return None

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
        elif isinstance(event, Stop):
            log.info("asked to stop")
            self._answer(self._rendezvous.stop())

    def _on_request(self, request: Request) -> None:
        decoded: tuple[Register | Exchange | Failed, dict[str, Array]] = decode(
            request.data, (Register, Exchange, Failed)
        )
        message, arrays = decoded
        if (request.role, request.rank) != (message.role, str(message.rank)):
            raise ProtocolError(
                f"the message of {message.role}/{message.rank} came on the key of"
                f" {request.role}/{request.rank}"
            )
        if isinstance(message, Register):
            self._on_register(request, message, arrays)
        elif isinstance(message, Exchange):
            self._on_exchange(request, message, arrays)
        else:
            self._on_failed(request, message)

    def _on_register(
        self, request: Request, message: Register, arrays: Mapping[str, Array]
    ) -> None:
        known = set(self._roster.entries)
        member = self._roster.enter(message, arrays)
        self._hold(member, request)
        if member not in known:
            self._look_up(member, message)
            self._patience.restart(START_FACTOR * self._base, time.monotonic())
            log.info("%s registered: %s, process %d", name(member), message.backend, message.pid)
            self._emit(Registered(name(member)))
        if not self._roster.missing():
            self._accept()

    def _accept(self) -> None:
        """Let those wait no longer who asked to register: all are here."""
        if self._maps is None:
            try:
                self._maps = self._roster.maps(self._schedule)
            except ProtocolError as error:
                # raised as another kind: a refusal would end the rank that asked, not the run
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
        answers = self._rendezvous.submit(member, message.step, _Part(message, arrays))
        self._hold(member, request)
        self._answer(answers)
        self._record()

    def _on_failed(self, request: Request, message: Failed) -> None:
        member: Member = (message.role, message.rank)
        if member not in self._roster.expected:
            raise ProtocolError(f"{name(member)} takes no part in this run")
        self._hold(member, request)
        dead = self._losses.first_dead()
        if dead is not None and dead != member:  # a victim, whose own words would mislead
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
                if member in self._roster.entries:
                    self._losses.down(member, now)

    # Decisions

    def _hold(self, member: Member, request: Request) -> None:
        """Keep a request until it is answered; one asked anew replaces the one before."""
        if (older := self._pending.pop(member, None)) is not None:
            older.drop()
        self._pending[member] = request

    def _answer(self, answers: list[Answer]) -> None:
        for answer in answers:
            if (request := self._pending.pop(answer.member, None)) is not None:
                reply = Reply(step=answer.step, directive=answer.directive)
                request.answer(encode(reply, self._fields(answer)))
        if answers:
            early = self._step <= FIRST_STEP
            self._patience.restart((START_FACTOR if early else 1.0) * self._base, time.monotonic())

    def _fields(self, answer: Answer) -> dict[str, Array]:
        """Fields for an answer, on the nodes that the rank needs."""
        if answer.source is None or self._maps is None:
            return {}
        parts = [part.fields for part in self._rendezvous.parts(*answer.source)]
        names = SCHEME_FIELDS[self._case.coupling.scheme][answer.source[0]]
        return {field: gather(parts, field, self._maps[answer.member]) for field in names}

    def _check_part(self, member: Member, message: Exchange, arrays: Mapping[str, Array]) -> None:
        """Compare a part with what the scheme and the registration promise.

        Raises
        ------
        ProtocolError
            A field is missing, has the wrong shape, or holds no finite numbers.
        """
        if unknown := set(message.energies) - set(QUANTITIES):
            raise ProtocolError(
                f"{name(member)} reports unknown quantities {sorted(unknown)};"
                f" known are {', '.join(QUANTITIES)}"
            )
        if self._case.only:
            return
        count = len(self._roster.entries[member].offers)
        for field in SCHEME_FIELDS[self._case.coupling.scheme][member[0]]:
            shape = (count, *_SHAPES[field])
            if field not in arrays:
                raise ProtocolError(f"{name(member)} sends no field {field!r}")
            if arrays[field].shape != shape or arrays[field].dtype != np.float64:
                raise ProtocolError(
                    f"{name(member)} sends {field!r} as {arrays[field].dtype} of shape"
                    f" {arrays[field].shape}; for its offers it must be float64 of shape {shape}"
                )
            if not np.isfinite(arrays[field]).all():
                raise ProtocolError(
                    f"{name(member)} sends {field!r} that is not finite at step {message.step}:"
                    " its solution has blown up; try a smaller time step"
                )

    def _record(self) -> None:
        """Write down the steps of which all parts have come in."""
        while self._step < self._rendezvous.last and self._rendezvous.is_complete(self._step + 1):
            self._step += 1
            parts = {role: self._rendezvous.parts(role, self._step) for role in self._schedule}
            entry = self._ledger.enter(
                {role: [part.message.energies for part in ranks] for role, ranks in parts.items()}
            )
            step, now = self.position()
            row: dict[str, float] = {
                "/series/step": step,
                "/series/time": now,
                "/series/total/energy": entry.energy,
                "/series/total/external_work": entry.external_work,
                "/series/total/balance": entry.balance,
                "/memory/coupler/0": peak_memory(),
            }
            for role, sums in entry.sides.items():
                row |= {f"/series/{role}/{quantity}": value for quantity, value in sums.items()}
            for role, ranks in parts.items():
                for rank, part in enumerate(ranks):
                    where = f"{role}/{rank}"
                    row[f"/memory/{where}"] = part.message.peak_memory
                    for phase, seconds in part.message.timings.items():
                        row[f"/timings/{where}/{phase}"] = seconds
            self._recorder.add(row)
            self._show_progress(step, now)

    def _show_progress(self, step: int, now: float) -> None:
        clock = time.monotonic()
        if clock - self._told >= _PROGRESS_SECONDS or step == self._rendezvous.last:
            self._told = clock
            self._emit(Progress(step, self._case.steps(), now))

    # Time

    def _watch(self, now: float) -> None:
        """Look whether somebody has been lost or silent for too long."""
        if self._rendezvous.finished():
            return
        if (member := self._losses.culprit(now)) is not None:
            self._lose(member)
        if (stage := self._patience.due(now)) is None:
            return
        silent = self._roster.missing() or self._rendezvous.awaited()
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
        """End the run because a rank is gone."""
        why = why or f"its connection is down and {self._state(member)}"
        step = self._step + 1
        self._end(
            PeerLostError(f"{name(member)} was lost at step {step}: {why}"),
            Lost(name(member), step, why),
        )

    def _end(self, error: GimpmdError, event: Lost | ServiceFailed) -> NoReturn:
        """End the run: tell the ranks that wait, tell the outside, and leave."""
        self.refuse_all(str(error), event.who)
        self._emit(event)
        raise error

    # Processes

    def _look_up(self, member: Member, register: Register) -> None:
        """Remember the process of a rank, if it runs here."""
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
        """Say what is known of the process of a rank."""
        process = self._processes.get(member)
        if process is None:
            return "it has not registered" if member in self._roster.missing() else "it is remote"
        if not self._is_running(member):
            return f"its process {process.pid} is gone"
        return f"its process {process.pid} is {process.status()}"

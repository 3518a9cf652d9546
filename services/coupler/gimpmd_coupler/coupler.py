"""The coupler: takes events one by one and decides.

Events are questions and connections of ranks, the wish to stop (from standard input or a signal),
and the passing of time. Questions are answered where they arrive, in the threads of the bus, under
a lock: to wake another thread up would take longer than the answer. What nobody waits for, books
and time, is left to the main thread.
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
from gimpmd_coupler.ledger import QUANTITIES, Ledger
from gimpmd_coupler.losses import Losses
from gimpmd_coupler.mapping import gather
from gimpmd_coupler.memory import peak_memory
from gimpmd_coupler.patience import Patience, Stage
from gimpmd_coupler.recorder import Recorder
from gimpmd_coupler.rendezvous import SCHEDULES, Answer, Member, Rendezvous, Schedule, name
from gimpmd_coupler.roster import Roster
from gimpmd_schemas.arrays import Ints
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.errors import GimpmdError, PeerLostError, ProtocolError
from gimpmd_schemas.wire.events import (
    Event,
    Lost,
    Progress,
    Registered,
    ServiceFailed,
    Waiting,
)
from gimpmd_schemas.wire.messages import (
    SCHEME_FIELDS,
    Accepted,
    Account,
    Array,
    Exchange,
    Failed,
    Refused,
    Register,
    Reply,
    Role,
    decode,
    encode,
)

log = logging.getLogger(__name__)

FIRST_STEP = 0
START_FACTOR = 6.0
"""Before the second step is done kernels are compiled and potentials read: more patience."""

_PROGRESS_SECONDS = 0.2
_BOOKS_SECONDS = 0.1  # how often the books are brought up to date
_LINGER_SECONDS = 10.0
_SHAPES = {"mass": (), "momentum": (2,), "velocity": (2,), "strain": (3,), "force": (2,)}


class Stop:
    """The wish to end the run at the next step."""


class Coupler:
    """Brings the ranks of a run together, step by step, until the end.

    Parameters
    ----------
    run : str
        Run id.
    case : Case
        The resolved case.
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
        emit: Callable[[Event], None],
        recorder: Recorder,
        deadline: float,
    ) -> None:
        self._case, self._emit, self._recorder = case, emit, recorder
        self._lock = threading.RLock()
        # for the main thread: `Stop`, errors that end the run, and "look again"
        self._notes: SimpleQueue[Stop | Exception | None] = SimpleQueue()
        self._base = deadline
        self._roster = Roster(run, case)
        self._schedule: Schedule = (
            dict.fromkeys(self._roster.ranks)
            if case.only
            else SCHEDULES[case.coupling.scheme, "serial"]
        )
        self._rendezvous: Rendezvous[Mapping[str, Array]] = Rendezvous(
            self._roster.ranks, self._schedule, FIRST_STEP, case.steps()
        )
        self._maps: dict[Member, Ints] | None = None
        self._pending: dict[Member, Request] = {}  # the last of each, until it is answered
        self._connected: set[Member] = set()
        self._processes: dict[Member, psutil.Process] = {}
        self._losses = Losses(self._is_running, RECONNECT_SECONDS)
        self._patience = Patience(START_FACTOR * deadline, time.monotonic())
        self._ledger = Ledger()
        self._accounts: dict[Member, dict[int, Account]] = {m: {} for m in self._roster.expected}
        self._booked = FIRST_STEP - 1  # last step in the ledger
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
        while self._booked < self._rendezvous.last:
            now = time.monotonic()
            dues = (self._patience.next_due(), self._losses.next_due(now), now + _BOOKS_SECONDS)
            self._heed(min(dues))
            with self._lock:
                complete = self._complete_accounts()
            for accounts in complete:
                self._record(accounts)
            with self._lock:
                self._watch(time.monotonic())

    def stop(self) -> None:
        """Ask for the end of the run at the next step; for signals and other threads."""
        self._notes.put(Stop())

    def take(self, event: Request | Token) -> None:
        """Handle what the bus brings, in the bus's own thread; an error ends the main thread."""
        try:
            with self._lock:
                self._handle(event)
        except Exception as error:
            self._notes.put(error)

    def stopped_early(self) -> bool:
        """Whether the run was ended before the end time of the case."""
        return self._rendezvous.last < self._case.steps()

    def position(self) -> tuple[int, float]:
        """Return the last step of which all parts are in, and its time."""
        return self._step, max(self._step, FIRST_STEP) * self._case.step()

    def refuse_all(self, reason: str, lost: str) -> None:
        """Answer whoever waits, and whoever asks from now on, that the run cannot go on."""
        with self._lock:
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
            self._heed(deadline)

    # Events

    def _heed(self, until: float) -> None:
        """Wait for a note, or until the time has come, and do what it says."""
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
        decoded: tuple[Register | Exchange | Account | Failed, dict[str, Array]] = decode(
            request.data, (Register, Exchange, Account, Failed)
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
        elif isinstance(message, Account):
            self._on_account(request, message)
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
        self._rendezvous.check(member, message.step)
        if message.account is not None:
            self._enter(member, message.account, message.step - 1)
        elif message.step > FIRST_STEP:
            raise ProtocolError(f"{name(member)} sends no account of step {message.step - 1}")
        answers = self._rendezvous.submit(member, message.step, arrays)
        self._pending[member] = request
        self._answer(answers)
        while self._step < self._rendezvous.last and self._rendezvous.is_complete(self._step + 1):
            self._step += 1

    def _on_account(self, request: Request, message: Account) -> None:
        """Take the last account of a rank, which no part follows."""
        member: Member = (message.role, message.rank)
        if member not in self._roster.entries:
            raise ProtocolError(f"{name(member)} takes no part in this run")
        self._enter(member, message, self._rendezvous.last)
        request.answer(encode(Reply(step=message.step, directive="stop")))
        self._notes.put(None)

    def _enter(self, member: Member, account: Account, step: int) -> None:
        """Keep an account until all are in; one that comes again is the same.

        Raises
        ------
        ProtocolError
            It is of another step or rank, or holds quantities that the ledger does not know.
        """
        if (account.role, account.rank, account.step) != (*member, step):
            raise ProtocolError(
                f"{name(member)} sends the account of {account.role}/{account.rank} at step"
                f" {account.step}; it must be its own of step {step}"
            )
        if unknown := set(account.energies) - set(QUANTITIES):
            raise ProtocolError(
                f"{name(member)} reports unknown quantities {sorted(unknown)};"
                f" known are {', '.join(QUANTITIES)}"
            )
        if step > self._booked:
            self._accounts[member].setdefault(step, account)

    def _on_failed(self, request: Request, message: Failed) -> None:
        member: Member = (message.role, message.rank)
        if member not in self._roster.expected:
            raise ProtocolError(f"{name(member)} takes no part in this run")
        self._pending[member] = request
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
        """Fields for an answer, on the nodes that the rank needs."""
        if answer.source is None or self._maps is None:
            return {}
        parts = self._rendezvous.parts(*answer.source)
        names = SCHEME_FIELDS[self._case.coupling.scheme][answer.source[0]]
        return {field: gather(parts, field, self._maps[answer.member]) for field in names}

    def _check_part(self, member: Member, message: Exchange, arrays: Mapping[str, Array]) -> None:
        """Compare a part with what the scheme and the registration promise.

        Raises
        ------
        ProtocolError
            A field is missing, has the wrong shape, or holds no finite numbers.
        """
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

    def _is_done(self, member: Member) -> bool:
        """Whether a rank has been told to stop and has closed its books."""
        last = self._rendezvous.last
        return last in self._accounts[member] or self._booked == last

    def _complete_accounts(self) -> list[dict[Member, Account]]:
        """Take out the accounts of the steps of which all are in, one step after another."""
        complete = []
        while all(self._booked + 1 in accounts for accounts in self._accounts.values()):
            self._booked += 1
            complete.append({m: kept.pop(self._booked) for m, kept in self._accounts.items()})
        return complete

    def _record(self, accounts: Mapping[Member, Account]) -> None:
        """Write down a step."""
        by_role: dict[Role, list[Account]] = {role: [] for role in self._schedule}
        for (role, _), account in accounts.items():
            by_role[role].append(account)
        entry = self._ledger.enter(
            {role: [account.energies for account in ranks] for role, ranks in by_role.items()}
        )
        step = next(iter(accounts.values())).step
        now = step * self._case.step()
        row: dict[str, float] = {
            "/series/step": step,
            "/series/time": now,
            "/series/total/energy": entry.energy,
            "/series/total/external_work": entry.external_work,
            "/series/total/dissipated": entry.dissipated,
            "/series/total/balance": entry.balance,
            "/memory/coupler/0": peak_memory(),
        }
        for role, sums in entry.sides.items():
            row |= {f"/series/{role}/{quantity}": value for quantity, value in sums.items()}
        for member, account in accounts.items():
            where = name(member)
            row[f"/memory/{where}"] = account.peak_memory
            for phase, seconds in account.timings.items():
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
        if self._booked == self._rendezvous.last:
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

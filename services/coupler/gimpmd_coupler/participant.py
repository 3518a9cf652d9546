"""The client library with which one rank of a service takes part in a run.

::

    with Participant(endpoint=..., run=..., plan=plan, role="md", rank=0, ranks=2,
                     backend="lammps 22Jul2025", patch=box) as participant:
        accepted = participant.register(offers=ids, needs=ids)
        incoming = participant.exchange(step, time, fields)
        participant.report(energies, timings)

A rank sends its fields straight to the ranks that need them. It reports its steps to the coupler
about twice a second, and the answers say how far it may go.
"""

from __future__ import annotations

import logging
import os
import signal
import socket
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any, Literal, Self

import numpy as np

from gimpmd_coupler.bus.connection import Answer, Connection, Payload, Reconnected, connect
from gimpmd_coupler.bus.settings import CONNECT_SECONDS
from gimpmd_coupler.exit import exit_code_of
from gimpmd_coupler.mapping import Link
from gimpmd_coupler.memory import peak_memory
from gimpmd_schemas.arrays import Ints
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.errors import GimpmdError, PeerLostError, ProtocolError, RefusedError
from gimpmd_schemas.grid.zones import Box
from gimpmd_schemas.wire import messages
from gimpmd_schemas.wire.energies import Energies
from gimpmd_schemas.wire.fields import Field, sent_fields
from gimpmd_schemas.wire.findings import Finding
from gimpmd_schemas.wire.messages import (
    PROTOCOL_VERSION,
    Accepted,
    Array,
    Failed,
    Grant,
    Refused,
    Register,
    Report,
    Saved,
    StepReport,
    decode,
    encode,
)

log = logging.getLogger(__name__)

Directive = Literal["advance", "stop"]

OTHER: Mapping[Role, Role] = {"md": "continuum", "continuum": "md"}
OFFSET: Mapping[Role, int] = {"md": 1, "continuum": 0}
"""At step k a role takes the other side's payload of step k plus this.

The continuum steps first, then the atoms follow its velocities (serial staggered coupling).
"""

AGAIN_SECONDS = (0.2, 5.0)
"""Times after which a rank asks for a payload that has not come: the first, which then doubles,
and the longest."""

NOTICE_SECONDS = 0.1
"""Time after which a rank tells the coupler whom it waits for."""

REPORT_SECONDS = 0.5
"""Time after which a rank reports, if it has not used up half of its grant before."""

WAIT_SECONDS = 1800.0
"""Time after which a wait is given up. The coupler watches the peers; this detects a coupler that
hangs."""

_FAREWELL_SECONDS = 2.0


class CulpritError(ProtocolError):
    """Another rank is at fault.

    Attributes
    ----------
    culprit : its name.
    """

    def __init__(self, culprit: str, message: str) -> None:
        super().__init__(message)
        self.culprit = culprit


@dataclass(frozen=True)
class Incoming:
    """What a rank learns at a step.

    Attributes
    ----------
    directive : ``advance``, or ``stop`` at the last step.
    fields : the other side's fields by name, on the nodes that this rank needs and in their
        order, shape ``(n, ...)``. Empty in a run of one side, and for the atoms at the stop: they
        would be the continuum's fields of the next step.
    """

    directive: Directive
    fields: dict[str, Array]


class Participant:
    """One rank of a service on the bus; a context manager.

    An exception that leaves the ``with`` block is reported to the coupler, which then ends the run
    and names this rank. Initialise MPI before the block, and do not fork inside it.

    Parameters
    ----------
    endpoint : str
        Endpoint of the coupler, as the coupler printed it.
    run : str
        Run id; must be the one of the coupler.
    plan : Plan
        Must be the plan of the coupler.
    role, rank, ranks
        Role and number of this rank, and the number of ranks of the role.
    backend : str
        Name and version of the code, for the log.
    patch : Box
        The part of the domain that this rank owns (length units).
    keys : Path, optional
        Folder of the keys of the run; needed for TLS.
    patience : float
        Seconds after which a rank that finds no coupler gives up.
    longest_wait : float
        Seconds after which it gives up any other wait.

    Raises
    ------
    InputError
        On entry: there are no keys.
    PeerLostError
        On entry: no coupler listens at the endpoint, or it does not accept the keys.
    """

    def __init__(
        self,
        *,
        endpoint: str,
        run: str,
        plan: Plan,
        role: Role,
        rank: int,
        ranks: int,
        backend: str,
        patch: Box,
        keys: Path | None = None,
        patience: float = CONNECT_SECONDS,
        longest_wait: float = WAIT_SECONDS,
    ) -> None:
        self._longest_wait = longest_wait
        self._keys, self._patience = keys, patience
        self._endpoint, self._run, self._plan = endpoint, run, plan
        self._role, self._rank, self._ranks = role, rank, ranks
        self._backend, self._patch = backend, patch
        scheme = plan.coupling.scheme if plan.coupling else None
        self._sent = sent_fields(role, scheme) if scheme else ()
        self._received = sent_fields(OTHER[role], scheme) if scheme else ()
        self._links: dict[str, Link] = {}  # by the name of the other rank
        self._order = np.empty(0, dtype=np.int64)  # of the needed nodes, in the nodes of all links
        self._offered = 0
        self._payloads: dict[tuple[str, int], dict[str, Array]] = {}  # by name of the rank and step
        self._forged: set[str] = set()  # ranks in whose name others have sent payloads
        self._step, self._last, self._granted, self._done = -1, -1, -1, -1
        self._steps: list[StepReport] = []  # not yet sent
        self._checkpoints: tuple[int, ...] = ()  # steps at which the coupler wants the state saved
        self._saved: list[Saved] = []  # not yet sent
        self._report_step = -1  # when half of the grant is used up
        self._stop: Literal["", "asked", "sent"] = ""
        self._holds: int | None = None  # where this rank stays after a recall
        self._reported_at = self._waited = 0.0
        self._resources = ExitStack()

    def __enter__(self) -> Self:
        self._connection: Connection = self._resources.enter_context(
            connect(self._endpoint, self._run, self._role, self._rank, self._keys, self._patience)
        )
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with self._resources:
            if error is not None and not isinstance(error, (PeerLostError, RefusedError)):
                self._report_error(error)

    def register(
        self, offers: Ints, needs: Ints, notes: tuple[str, ...] = (), first_step: int = 0
    ) -> Accepted:
        """Ask to take part. Returns when all ranks of all roles have been accepted.

        Parameters
        ----------
        offers, needs : ndarray of int64, shape ``(n,)`` and ``(m,)``
            Ids of the nodes whose fields this rank sends, and of the nodes whose fields it needs.
        notes : tuple of str
            What the user should know about the results, one sentence each; kept in ``run.h5``.
        first_step : int
            Step of the checkpoint from which this rank goes on; 0 without one.

        Raises
        ------
        RefusedError
            The coupler does not accept this rank; the message gives the reason.
        PeerLostError
            The coupler or another rank died.
        """
        message = Register(
            protocol=PROTOCOL_VERSION,
            run=self._run,
            plan=self._plan.digest(),
            role=self._role,
            rank=self._rank,
            ranks=self._ranks,
            backend=self._backend,
            units=self._plan.units,
            dt=self._plan.step,
            patch=self._patch,
            host=socket.gethostname(),
            pid=os.getpid(),
            notes=notes,
            first_step=first_step,
        )
        self._connection.request("register", encode(message, {"offers": offers, "needs": needs}))
        decoded: tuple[Accepted | Refused, dict[str, Array]] = decode(
            self._answer(self._longest_wait), (Accepted, Refused)
        )
        answer, arrays = decoded
        if isinstance(answer, Refused):
            if answer.lost:
                raise PeerLostError(answer.reason)
            raise RefusedError(f"the coupler refused {self._role}/{self._rank}: {answer.reason}")
        self._offered = offers.size
        self._links = {
            f"{OTHER[self._role]}/{k}": Link(arrays[f"rows_{k}"], arrays[f"places_{k}"])
            for k in answer.sources
        }
        places = np.concatenate([link.places for link in self._links.values()] or [needs[:0]])
        self._order = np.argsort(places)
        self._connection.subscribe(self._links)
        self._step = self._done = answer.first_step - 1
        self._last, self._granted = answer.last_step, answer.granted
        return answer

    def exchange(
        self,
        step: int,
        time: float,
        fields: Mapping[str, Array],
        meanwhile: Callable[[], None] | None = None,
    ) -> Incoming:
        """Send the fields of a step and wait for those of the other side.

        Parameters
        ----------
        step : int
            Coupling step. Steps follow one another from ``Accepted.first_step`` on.
        time : float
            Time of the step (time units).
        fields : mapping of names to ndarray, shape ``(n, ...)``
            The fields of this role (`fields.sent_fields`), on the offered nodes in their order.
        meanwhile : callable, optional
            Work that no other rank waits for. It is called once while the fields are on their way;
            after that the process sleeps.

        Returns
        -------
        Incoming

        Raises
        ------
        ProtocolError
            Wrong step, or fields that do not fit the nodes, of this rank or of another one.
        PeerLostError
            The coupler, or a rank of either side, died or failed; the message names it.
        """
        if step != self._step + 1:
            raise ProtocolError(f"{self._name} exchanges step {step} after step {self._step}")
        if self._sent and self._offered:
            self._check_own(step, fields)
            message = messages.Payload(role=self._role, rank=self._rank, step=step)
            self._connection.publish(step, encode(message, fields))
        self._step = step
        if meanwhile is not None:
            meanwhile()
        start = _now()
        self._wait()
        self._waited = _now() - start
        stop = step == self._last
        return Incoming("stop" if stop else "advance", self._gather())

    @property
    def member(self) -> tuple[Role, int]:
        """Role and number of this rank."""
        return self._role, self._rank

    def must_save(self) -> bool:
        """Whether a checkpoint belongs to the step last exchanged."""
        wanted = self._plan.checkpoint
        at_all = wanted is not None and wanted.seconds is None and self._plan.renews(self._step)
        return at_all or self._step in self._checkpoints

    def note_saved(self, digest: str) -> None:
        """Tell the coupler, with the next report, that the state at this step has been saved.

        Parameters
        ----------
        digest : str
            SHA-256 of the file, in hex.
        """
        self._saved.append(Saved(step=self._step, digest=digest))

    def report(
        self,
        energies: Energies | None,
        timings: Mapping[str, float],
        findings: tuple[Finding, ...] = (),
    ) -> None:
        """Report on the step last exchanged: before the next exchange, and after the stop.

        Reports are sent together about twice a second. After the stop this waits until all
        ranks have completed the last step.

        Parameters
        ----------
        energies : Energies or None
            Conserved quantities of this rank at the step. None at steps without energies.
        timings : mapping
            Wall seconds since the previous report by phase; ``wait`` is added.
        findings : tuple of Finding, optional
            What the monitors of this rank found at the step.

        Raises
        ------
        ProtocolError
            The coupler refused a report.
        PeerLostError
            The coupler or another rank died.
        """
        self._steps.append(
            StepReport(
                step=self._step,
                energies=energies,
                timings={**timings, "wait": self._waited},
                findings=findings,
            )
        )
        if self._step == self._last:
            self._settle()
            while self._steps or self._done < self._last:
                self._send_report()
                self._settle()
        elif not self._connection.pending and (
            self._step >= self._report_step
            or _now() > self._reported_at + REPORT_SECONDS
            or self._stop == "asked"
        ):
            self._send_report()

    def heed_sigterm(self) -> None:
        """Let SIGTERM stop the run cleanly.

        Before the registration, and the second time, it ends this process.
        """
        signal.signal(signal.SIGTERM, self._on_sigterm)

    def _on_sigterm(self, number: int, frame: FrameType | None) -> None:
        if self._stop or self._last < 0:
            raise SystemExit("ended by SIGTERM")
        self.ask_to_stop()

    def ask_to_stop(self) -> None:
        """Ask the coupler, with the next report, to end the run; after the registration."""
        self._stop = self._stop or "asked"

    # Waiting

    @property
    def _name(self) -> str:
        return f"{self._role}/{self._rank}"

    @property
    def _source(self) -> int:
        """Step of the payloads that this rank takes now."""
        return self._step + OFFSET[self._role]

    def _missing(self) -> list[str]:
        """Names of the ranks whose payload has not come."""
        if self._source > self._last:  # there are no payloads beyond
            return []
        return [peer for peer in self._links if (peer, self._source) not in self._payloads]

    def _ready(self) -> bool:
        """Whether the rank may advance, or knows that this is the last step, and has all fields."""
        return (self._step < self._granted or self._step == self._last) and not self._missing()

    def _wait(self) -> None:
        """Take what arrives until the rank can go on."""
        start = _now()
        pause, longest = AGAIN_SECONDS
        ask_at, noticed = start + pause, False
        while (item := self._take_next(0.0)) is not None:  # a recall concerns ranks that are ready
            if isinstance(item, Reconnected):
                ask_at = start
        while not self._ready():
            item = self._take_next(NOTICE_SECONDS)
            now, missing = _now(), self._missing()
            if isinstance(item, Reconnected):
                ask_at = now
            elif item is not None:
                continue
            if not (noticed and self._stop != "asked") and not self._connection.pending:
                self._send_report(tuple(missing))
                noticed = True
            if now >= ask_at:
                pause = min(2.0 * pause, longest)
                ask_at = now + pause
                for peer in missing:
                    self._connection.ask_again(peer, self._source)
            if now > start + self._longest_wait:
                raise PeerLostError(
                    f"{self._name} has waited {self._longest_wait:g} s at step {self._step} for"
                    f" {', '.join(missing) or 'the coupler'}: see logs/coupler.log"
                )

    def _settle(self) -> None:
        """Take what arrives until the pending request is answered."""
        deadline = _now() + self._longest_wait
        while self._connection.pending:
            self._take_next(NOTICE_SECONDS)
            if _now() > deadline:
                raise self._silent(self._longest_wait)

    def _take_next(self, timeout: float) -> Answer | Payload | Reconnected | None:
        """Take the next message and return it; None if none came in time."""
        item = self._connection.receive(timeout)
        if isinstance(item, Answer):
            self._take_answer(item.data)
        elif isinstance(item, Payload):
            self._take_payload(item)
        return item

    def _take_answer(self, data: bytes) -> None:
        decoded: tuple[Grant | Refused, Any] = decode(data, (Grant, Refused))
        answer, _ = decoded
        if isinstance(answer, Refused):
            raise (PeerLostError if answer.lost else ProtocolError)(answer.reason)
        self._granted, self._last, self._done = answer.granted, answer.last, answer.done
        self._checkpoints = answer.checkpoints
        self._report_step = (self._step + self._granted) // 2
        self._holds = None
        self._connection.forget(answer.done)
        if answer.recall:
            self._granted = self._holds = self._step
            if not self._connection.pending:
                self._send_report()

    def _take_payload(self, payload: Payload) -> None:
        """Keep the payload of another rank; one that came before changes nothing.

        What is no payload of that rank does not come from it, and is left alone. The rank's own
        payload is still on its way.
        """
        peer = payload.peer
        try:
            decoded: tuple[messages.Payload, dict[str, Array]] = decode(
                payload.data, messages.Payload
            )
        except ProtocolError as error:
            self._ignore(peer, str(error))
            return
        message, arrays = decoded
        if f"{message.role}/{message.rank}" != peer:
            self._ignore(peer, f"it is one of {message.role}/{message.rank}")
            return
        if message.step >= self._step + (self._role == "md"):
            self._payloads.setdefault((peer, message.step), arrays)

    def _ignore(self, peer: str, reason: str) -> None:
        """Say it once for each rank: there may be many."""
        if peer not in self._forged:
            log.warning("ignored a payload in the name of %s: %s", peer, reason)
        self._forged.add(peer)

    # Fields

    def _gather(self) -> dict[str, Array]:
        """Return the fields of the other side on the needed nodes; none beyond the last step."""
        dim, step = self._plan.dim, self._source
        if step > self._last:
            return {}
        parts: dict[str, list[Array]] = {field.name: [] for field in self._received}
        for peer, link in self._links.items():
            arrays = self._payloads[peer, step]
            for field in self._received:
                array = arrays.get(field.name)
                reason = _misfit(field, array, dim, link.least)
                if array is None or reason:
                    raise CulpritError(peer, f"{peer} sends at step {step} {reason}")
                parts[field.name].append(array.take(link.rows, axis=0))  # faster than array[rows]
        self._payloads = {key: kept for key, kept in self._payloads.items() if key[1] > step}
        return {f.name: self._join(parts[f.name], f.shape(dim)) for f in self._received}

    def _join(self, parts: list[Array], shape: tuple[int, ...]) -> Array:
        """Put the nodes of all links into the order in which they are needed."""
        if len(parts) == 1:
            return parts[0]
        return np.concatenate([np.empty((0, *shape)), *parts]).take(self._order, axis=0)

    def _check_own(self, step: int, fields: Mapping[str, Array]) -> None:
        for field in self._sent:
            array = fields.get(field.name)
            reason = _misfit(field, array, self._plan.dim, self._offered)
            if array is not None and not reason and array.shape[0] != self._offered:
                reason = f"{field.name!r} on {array.shape[0]} nodes; it offers {self._offered}"
            if reason:
                raise ProtocolError(f"{self._name} sends at step {step} {reason}")

    # Reports

    def _send_report(self, waits_for: tuple[str, ...] = ()) -> None:
        message = Report(
            role=self._role,
            rank=self._rank,
            steps=tuple(self._steps),
            peak_memory=peak_memory(),
            waits_for=waits_for,
            holds=self._holds,
            saved=tuple(self._saved),
            stop=bool(self._stop),
        )
        self._stop = "sent" if self._stop else ""
        self._connection.request("report", encode(message))
        self._steps, self._saved, self._reported_at = [], [], _now()

    def _answer(self, patience: float) -> bytes:
        """Wait for the answer to the pending request."""
        deadline = _now() + patience
        while _now() < deadline:
            item = self._connection.receive(NOTICE_SECONDS)
            if isinstance(item, Answer) and item.asked:
                return item.data
        raise self._silent(patience)

    def _silent(self, patience: float) -> PeerLostError:
        return PeerLostError(
            f"the coupler at {self._endpoint} has not answered for {patience:g} s"
            " although it is connected: see logs/coupler.log"
        )

    def _report_error(self, error: BaseException) -> None:
        """Tell the coupler why this rank cannot go on."""
        message = str(error)
        if not isinstance(error, GimpmdError):
            message = f"{type(error).__name__}: {error}"
        failed = Failed(
            role=self._role,
            rank=self._rank,
            message=message,
            exit_code=exit_code_of(error),
            culprit=error.culprit if isinstance(error, CulpritError) else "",
        )
        try:
            self._connection.request("failed", encode(failed))
            self._answer(_FAREWELL_SECONDS)
        except PeerLostError as lost:
            log.warning("could not report the failure: %s", lost)


def _misfit(field: Field, array: Array | None, dim: int, least: int) -> str:
    """Say what is wrong with the values of a field; empty if nothing is."""
    if array is None:
        return f"no field {field.name!r}"
    shape = field.shape(dim)
    if array.dtype != np.float64 or array.shape[1:] != shape or array.shape[0] < least:
        return (
            f"{field.name!r} as {array.dtype} of shape {array.shape}; it must be float64 of shape"
            f" {(least, *shape)}"
        )
    if np.count_nonzero(np.isfinite(array)) < array.size:  # faster than all()
        return (
            f"{field.name!r} that is not finite: its solution has blown up; try a smaller time step"
        )
    return ""


_now = time.perf_counter

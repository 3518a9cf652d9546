"""The client library with which one rank of a service takes part in a run.

::

    with Participant(endpoint=..., run=..., plan=plan, role="md", rank=0, ranks=2,
                     backend="lammps 22Jul2025", patch=box) as participant:
        accepted = participant.register(offers=ids, needs=ids)
        incoming = participant.exchange(step, time, fields)
        participant.report(energies, timings)
"""

from __future__ import annotations

import logging
import os
import socket
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Literal, Self

from gimpmd_coupler.bus import Connection, connect
from gimpmd_coupler.exit import exit_code_of
from gimpmd_coupler.memory import peak_memory
from gimpmd_schemas.arrays import Ints
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.errors import GimpmdError, PeerLostError, ProtocolError, RefusedError
from gimpmd_schemas.grid.zones import Box
from gimpmd_schemas.wire.broken_bonds import BrokenBonds
from gimpmd_schemas.wire.energies import Energies
from gimpmd_schemas.wire.messages import (
    PROTOCOL_VERSION,
    Accepted,
    Array,
    Directive,
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

_PATIENCE_SECONDS = 1800.0  # the coupler watches the peers; this detects a coupler that hangs
_FAREWELL_SECONDS = 2.0


@dataclass(frozen=True)
class Incoming:
    """The answer to an exchange.

    Attributes
    ----------
    directive : ``advance``, or ``stop`` at the last step.
    fields : the other side's fields by name, on the nodes that this rank needs and in their
        order, shape ``(n, ...)``, read-only. Empty in a run of one side, and for the atoms at the
        stop: their answer would hold the continuum's fields of the next step.
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

    Raises
    ------
    PeerLostError
        On entry: no coupler listens at the endpoint.
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
    ) -> None:
        self._endpoint, self._run, self._plan = endpoint, run, plan
        self._digest = plan.digest()
        self._role, self._rank, self._ranks = role, rank, ranks
        self._backend, self._patch = backend, patch
        self._waited = 0.0
        self._step, self._stopped = -1, False
        self._report: Report | None = None  # of the last step, not yet sent
        self._resources = ExitStack()

    def __enter__(self) -> Self:
        self._connection: Connection = self._resources.enter_context(
            connect(self._endpoint, self._run, self._role, self._rank)
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

    def register(self, offers: Ints, needs: Ints, notes: tuple[str, ...] = ()) -> Accepted:
        """Ask to take part. Returns when all ranks of all roles have been accepted.

        Parameters
        ----------
        offers, needs : ndarray of int64, shape ``(n,)`` and ``(m,)``
            Ids of the nodes whose fields this rank sends, and of the nodes whose fields it needs.
        notes : tuple of str
            What the user should know about the results, one sentence each; kept in ``run.h5``.

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
            plan=self._digest,
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
        )
        frame = encode(message, {"offers": offers, "needs": needs})
        data = self._connection.ask("register", frame, _PATIENCE_SECONDS)
        decoded: tuple[Accepted | Refused, Any] = decode(data, (Accepted, Refused))
        answer, _ = decoded
        if isinstance(answer, Refused):
            if answer.lost:
                raise PeerLostError(answer.reason)
            raise RefusedError(f"the coupler refused {self._role}/{self._rank}: {answer.reason}")
        return answer

    def exchange(
        self,
        step: int,
        time: float,
        fields: Mapping[str, Array],
        meanwhile: Callable[[], None] | None = None,
    ) -> Incoming:
        """Send the part of a step and wait for the part of the other side.

        Parameters
        ----------
        step : int
            Coupling step. Steps follow one another from ``Accepted.first_step`` on.
        time : float
            Time of the step (time units).
        fields : mapping of names to ndarray, shape ``(n, ...)``
            The fields of this role (`fields.sent_fields`), on the offered nodes in their order.
        meanwhile : callable, optional
            Work that no other rank waits for. It is called once while the part is on its way;
            after that the process sleeps.

        Returns
        -------
        Incoming

        Raises
        ------
        ProtocolError
            The coupler refused the part: wrong step, no report of the previous step, or fields
            that do not fit the nodes.
        PeerLostError
            The coupler, or a rank of either side, died or failed; the message names it.
        """
        message = Exchange(
            protocol=PROTOCOL_VERSION,
            run=self._run,
            plan=self._digest,
            role=self._role,
            rank=self._rank,
            step=step,
            time=time,
            report=self._report,
        )
        worked = 0.0

        def work() -> None:
            nonlocal worked
            start = _now()
            if meanwhile is not None:
                meanwhile()
            worked = _now() - start

        start = _now()
        answer, arrays = self._ask("exchange", step, encode(message, fields), work)
        self._waited = _now() - start - worked
        self._step, self._stopped = step, answer.directive == "stop"
        self._report = None
        return Incoming(answer.directive, arrays)

    def report(
        self,
        energies: Energies | None,
        timings: Mapping[str, float],
        broken_bonds: BrokenBonds | None = None,
    ) -> None:
        """Report on the step last exchanged: before the next exchange, and after the stop.

        The report is sent with the next part or, after the stop, at once.

        Parameters
        ----------
        energies : Energies or None
            Conserved quantities of this rank at the step. None at steps without energies.
        timings : mapping
            Wall seconds since the previous report by phase; ``wait`` is added.
        broken_bonds : BrokenBonds, optional
            Of this rank's atoms near the planes.

        Raises
        ------
        ProtocolError
            After the stop: the coupler refused the report.
        PeerLostError
            After the stop: the coupler died.
        """
        self._report = Report(
            role=self._role,
            rank=self._rank,
            step=self._step,
            energies=energies,
            timings={**timings, "wait": self._waited},
            peak_memory=peak_memory(),
            broken_bonds=broken_bonds,
        )
        if self._stopped:
            self._ask("report", self._step, encode(self._report))

    def _ask(
        self,
        kind: Literal["exchange", "report"],
        step: int,
        frame: bytes,
        meanwhile: Callable[[], None] | None = None,
    ) -> tuple[Reply, dict[str, Array]]:
        data = self._connection.ask(kind, frame, _PATIENCE_SECONDS, meanwhile)
        decoded: tuple[Reply | Refused, dict[str, Array]] = decode(data, (Reply, Refused))
        answer, arrays = decoded
        if isinstance(answer, Refused):
            error = PeerLostError if answer.lost else ProtocolError
            raise error(answer.reason)
        if answer.step != step:
            raise ProtocolError(f"the coupler answered step {answer.step} instead of {step}")
        return answer, arrays

    def _report_error(self, error: BaseException) -> None:
        """Tell the coupler why this rank cannot go on."""
        message = str(error)
        if not isinstance(error, GimpmdError):
            message = f"{type(error).__name__}: {error}"
        failed = Failed(
            role=self._role, rank=self._rank, message=message, exit_code=exit_code_of(error)
        )
        try:
            self._connection.ask("failed", encode(failed), _FAREWELL_SECONDS)
        except PeerLostError as lost:
            log.warning("could not report the failure: %s", lost)


_now = time.perf_counter

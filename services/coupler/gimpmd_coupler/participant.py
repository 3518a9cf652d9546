"""The client library: how a service takes part in a run.

::

    with Participant(endpoint=..., run=..., case=case, role="md", rank=0, ranks=2,
                     backend="lammps 22Jul2025", patch=box) as participant:
        accepted = participant.register(offers=ids, needs=ids)
        incoming = participant.exchange(step, time, fields)
        participant.account(energies, timings)
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
from gimpmd_coupler.memory import peak_memory
from gimpmd_schemas.arrays import Ints
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.errors import GimpmdError, PeerLostError, ProtocolError, RefusedError
from gimpmd_schemas.grid.zones import Box
from gimpmd_schemas.wire.messages import (
    PROTOCOL_VERSION,
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

_PATIENCE_SECONDS = 1800.0  # the coupler watches the peers; this only catches a coupler that hangs
_FAREWELL_SECONDS = 2.0


@dataclass(frozen=True)
class Incoming:
    """What came back from an exchange.

    Attributes
    ----------
    directive : ``stop`` ends the run: nothing further is exchanged.
    fields : the other side's fields by name, on the nodes that this rank needs and in their
        order, shape ``(n, ...)``, read-only; empty in a run of one side alone, and at the stop if
        the scheme answers with the step to come.
    """

    directive: Literal["advance", "checkpoint", "restore", "stop"]
    fields: dict[str, Array]


class Participant:
    """One rank of a service on the bus; a context manager.

    Leaving the ``with`` block by an exception reports it to the coupler, which then ends the run
    and names this rank. MPI must be initialised before the block, and nothing may be forked
    inside it.

    Parameters
    ----------
    endpoint : str
        Where the coupler listens, as it printed it.
    run : str
        Run id; must be the coupler's.
    case : Case
        The resolved case; must be the coupler's.
    role, rank, ranks
        Who this is, and how many ranks the role has.
    backend : str
        Name and version of the implementation, for the records.
    patch : Box
        What this rank owns (length units).

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
        case: Case,
        role: Role,
        rank: int,
        ranks: int,
        backend: str,
        patch: Box,
    ) -> None:
        self._endpoint, self._run, self._case = endpoint, run, case
        self._digest = case.digest()
        self._role, self._rank, self._ranks = role, rank, ranks
        self._backend, self._patch = backend, patch
        self._waited = 0.0
        self._step, self._stopped = -1, False
        self._account: Account | None = None  # of the last step, not yet handed in
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
                self._report(error)

    def register(self, offers: Ints, needs: Ints) -> Accepted:
        """Ask to take part; returns once all ranks of all roles have been accepted.

        Parameters
        ----------
        offers, needs : ndarray of int64, shape ``(n,)`` and ``(m,)``
            Ids of the nodes whose fields this rank sends, and of those it wants.

        Raises
        ------
        RefusedError
            The coupler does not take this rank; the message gives the reason.
        PeerLostError
            The coupler or another rank died.
        """
        message = Register(
            protocol=PROTOCOL_VERSION,
            run=self._run,
            case=self._digest,
            role=self._role,
            rank=self._rank,
            ranks=self._ranks,
            backend=self._backend,
            units=self._case.units,
            dt=self._case.step(),
            patch=self._patch,
            host=socket.gethostname(),
            pid=os.getpid(),
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
        """Hand in the part of a step and wait for the other side's.

        Parameters
        ----------
        step : int
            Coupling step, from ``Accepted.first_step`` on, one after the other.
        time : float
            Time of the step (time units).
        fields : mapping of names to ndarray, shape ``(n, ...)``
            What the scheme asks of this role, on the nodes offered and in their order.
        meanwhile : callable, optional
            Work on which nobody waits, called once while the part is on its way; after that the
            process sleeps.

        Returns
        -------
        Incoming

        Raises
        ------
        ProtocolError
            The coupler refused the part: wrong step, no account of the step before, or fields that
            do not fit the nodes.
        PeerLostError
            The coupler, or a rank of either side, died or failed; the message names it.
        """
        message = Exchange(
            protocol=PROTOCOL_VERSION,
            run=self._run,
            case=self._digest,
            role=self._role,
            rank=self._rank,
            step=step,
            time=time,
            account=self._account,
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
        self._account = None
        return Incoming(answer.directive, arrays)

    def account(self, energies: Mapping[str, float], timings: Mapping[str, float]) -> None:
        """Give the books of the step last exchanged: before the next exchange, and at the stop.

        They go out with the next part or, after the stop, at once.

        Parameters
        ----------
        energies : mapping
            Conserved quantities of this rank at the step (``ledger.QUANTITIES``, energy units).
        timings : mapping
            Wall seconds since the last account by phase; ``wait`` is added.

        Raises
        ------
        ProtocolError
            After the stop: the coupler refused the books.
        PeerLostError
            After the stop: the coupler died.
        """
        self._account = Account(
            role=self._role,
            rank=self._rank,
            step=self._step,
            energies=dict(energies),
            timings={**timings, "wait": self._waited},
            peak_memory=peak_memory(),
        )
        if self._stopped:
            self._ask("account", self._step, encode(self._account))

    def _ask(
        self,
        kind: Literal["exchange", "account"],
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

    def _report(self, error: BaseException) -> None:
        """Tell the coupler why this rank cannot go on."""
        message = (
            str(error) if isinstance(error, GimpmdError) else f"{type(error).__name__}: {error}"
        )
        failed = Failed(
            role=self._role,
            rank=self._rank,
            message=message,
            exit_code=error.exit_code if isinstance(error, GimpmdError) else 3,
        )
        try:
            self._connection.ask("failed", encode(failed), _FAREWELL_SECONDS)
        except PeerLostError as lost:
            log.warning("could not report the failure: %s", lost)


_now = time.perf_counter

"""The loop of a service: register, then exchange and advance in lockstep until the stop."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from gimpmd_coupler.participant import Participant
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.checkpoint.states import SavedStates, save_state
from gimpmd_schemas.errors import GimpmdError
from gimpmd_schemas.wire.energies import Energies
from gimpmd_schemas.wire.findings import Finding

log = logging.getLogger(__name__)

Array = np.ndarray[Any, np.dtype[Any]]


class Timings:
    """Wall seconds by phase since they were last taken."""

    def __init__(self) -> None:
        self._seconds: dict[str, float] = {}

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Add the wall time of a block to a phase."""
        start = time.perf_counter()
        yield
        self._seconds[name] = self._seconds.get(name, 0.0) + time.perf_counter() - start

    def take(self) -> dict[str, float]:
        """Return the seconds by phase and start again at zero."""
        seconds, self._seconds = self._seconds, {}
        return seconds


class Side(Protocol):
    """One rank of one side of the run: atoms or continuum.

    At coupling step k the state of a side belongs to time t_k. The loop calls the methods in this
    order: ``zone_fields``, ``finish``, ``write`` (if output is due), ``receive``, ``advance``,
    ``energies``, ``findings``; at the last step there is no ``advance``.

    Attributes
    ----------
    offers, needs : ids of the nodes whose fields this rank sends and receives, shapes ``(n,)`` and
        ``(m,)``.
    notes : what the user should know about the results, one sentence each; they go into
        ``run.h5`` and the report.
    timings : wall times of the phases of this side.
    """

    offers: Ints
    needs: Ints
    timings: Timings

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences for the report."""

    def zone_fields(self) -> Mapping[str, Floats]:
        """Fields of this role at t_k (`fields.sent_fields`), first axis in order of ``offers``."""

    def finish(self) -> None:
        """Finish step k: all work that the other side does not wait for.

        It runs while the fields are on their way.
        """

    def write(self, time: float) -> None:
        """Write the state at t_k to the output files."""

    def receive(self, fields: Mapping[str, Floats]) -> None:
        """Take the other side's fields, first axis in order of ``needs``.

        There are no fields in a run of one side, and none for the atoms at the last step.
        """

    def advance(self) -> None:
        """Advance to t_{k+1}, as far as the next ``zone_fields`` need it."""

    def energies(self) -> Energies | None:
        """Conserved quantities of this rank at t_k, or None at a step without energies.

        They belong to the step of the last ``finish``, although ``advance`` has been called since:
        some schemes know the work of a step only then.
        """

    def findings(self) -> tuple[Finding, ...]:
        """What the monitors of this side found at the last ``finish``; collective.

        It is called after ``energies``. Monitors look at some steps only (`monitors_look`).
        """

    def renew(self) -> None:
        """Compute the state at t_k anew from what `state` holds; collective.

        Called between ``finish`` and ``receive``, at steps that the plan fixes (`Plan.renews`) and
        before a checkpoint. A run that goes on from the checkpoint then has the same bits.
        """

    def state(self) -> Mapping[str, Array]:
        """All that this rank needs to go on from t_k, after `renew`; see `checkpoint.states`."""

    def close(self) -> None:
        """Close the code and its files."""


def run_service(
    side: Side,
    plan: Plan,
    participant: Participant,
    run_dir: Path,
    saved: SavedStates | None = None,
) -> None:
    """Take part in a run from registration to stop.

    Parameters
    ----------
    side : Side
    plan : Plan
    participant : Participant
        On the bus, not yet registered.
    run_dir : Path
        Folder of the run, for checkpoints.
    saved : SavedStates, optional
        The checkpoint from which the side goes on, in the state in which it was saved.

    Raises
    ------
    RefusedError, ProtocolError
        The coupler refused this rank or a part of it.
    PeerLostError
        The coupler or another rank died.
    """
    step = 0 if saved is None else saved.step
    accepted = participant.register(side.offers, side.needs, side.notes, step)
    log.info("accepted for steps %d to %d", accepted.first_step, accepted.last_step)
    restored = saved is not None  # the step of a checkpoint has been finished
    while True:
        now = step * plan.step
        output = now if plan.is_output(step) else None
        meanwhile = None if restored else partial(_finish, side, output)
        incoming = participant.exchange(step, now, side.zone_fields(), meanwhile)
        if not restored:
            _keep(side, plan, participant, run_dir, step)
        restored = False
        side.receive(incoming.fields)
        if incoming.directive == "advance":
            side.advance()
        participant.report(side.energies(), side.timings.take(), side.findings())
        if incoming.directive == "stop":
            log.info("stopped at step %d, t = %g", step, now)
            return
        step += 1


def _finish(side: Side, output: float | None) -> None:
    """Finish a step, and write the output if its time is given."""
    side.finish()
    if output is not None:
        with side.timings.phase("output"):
            side.write(output)


def _keep(side: Side, plan: Plan, participant: Participant, run_dir: Path, step: int) -> None:
    """Renew the state at the steps at which the plan says so, and save it for a checkpoint.

    Raises
    ------
    GimpmdError
        The state cannot be written.
    """
    must_save = participant.must_save()
    if not must_save and not plan.renews(step):
        return
    with side.timings.phase("checkpoint"):
        side.renew()
        if must_save:
            role, rank = participant.member
            try:
                digest = save_state(run_dir, step, role, rank, side.state())
            except OSError as error:
                raise GimpmdError(f"cannot save the checkpoint of step {step}: {error}") from error
            participant.note_saved(digest)

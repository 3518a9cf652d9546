"""The books of a run: the reports of all ranks, their sums, and what the monitors found.

Reports are entered in the thread of the bus. Steps for which all ranks have reported are recorded
by the main thread, because no rank waits for that.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Mapping
from itertools import chain

import numpy as np

from gimpmd_coupler.body_watch import BodyWatch
from gimpmd_coupler.frame_writer import FrameWriter
from gimpmd_coupler.ledger import Ledger
from gimpmd_coupler.memory import peak_memory
from gimpmd_coupler.recorder import Recorder
from gimpmd_coupler.roster import Roster
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.checkpoint.manifest import Manifest
from gimpmd_schemas.wire.energies import Energies, components, total
from gimpmd_schemas.wire.events import Event, Found
from gimpmd_schemas.wire.fields import TOTAL_FIELDS
from gimpmd_schemas.wire.findings import Finding, Side, sentence, worst
from gimpmd_schemas.wire.messages import Array, Member, StepReport

log = logging.getLogger(__name__)

Reported = tuple[StepReport, int]
"""What a rank reports of a step, and the peak memory of its process (bytes)."""


class Books:
    """Keeps what the ranks report of each step, and writes it to ``run.h5`` step by step.

    Parameters
    ----------
    plan : Plan
    roster : Roster
    emit : callable
        Called with each finding of the monitors that is the first of its kind.
    recorder : Recorder
    start : Manifest, optional
        The checkpoint from which the run goes on.
    frames : FrameWriter, optional
        Writes the recording of a run that is recorded.

    Attributes
    ----------
    recorded : int
        Last step that has been taken out by `take_complete`.
    defect : str
        What the user was told of the first finding; empty if there is none.
    """

    def __init__(
        self,
        plan: Plan,
        roster: Roster,
        emit: Callable[[Event], None],
        recorder: Recorder,
        start: Manifest | None,
        frames: FrameWriter | None,
    ) -> None:
        self._plan, self._ranks, self._emit = plan, roster.ranks, emit
        self._recorder, self._frames = recorder, frames
        first = 0 if start is None else start.step
        self.recorded = first - 1
        self._ledger = Ledger(None if start is None else start.start_energy)
        self._reports: dict[Member, dict[int, Reported]] = {m: {} for m in roster.expected}
        self._body = BodyWatch(plan)
        looks = [step for step in range(first) if self._body.looks(step)]
        self._body.catch_up(zip(*(recorder.sides(role, looks) for role in plan.roles), strict=True))
        self._of_body: dict[int, tuple[Finding, ...]] = {}  # findings about the whole body, by step
        told = recorder.told()
        self._told = set(told)  # sides and kinds of findings
        self.defect = next(iter(told.values()), "")

    @property
    def start_energy(self) -> float | None:
        """Energy of the body at the start of the run, once it is known."""
        return self._ledger.start

    def enter(self, member: Member, reports: Iterable[StepReport], memory: int) -> None:
        """Enter reports of a rank about steps of which it has not reported before."""
        self._reports[member].update((report.step, (report, memory)) for report in reports)

    def defect_of_body(self, steps: range) -> int | None:
        """Let the monitor of the whole body look at steps that all ranks have just completed.

        Returns
        -------
        int or None
            The first step at which it found something.
        """
        for step in filter(self._body.looks, steps):
            reports = {member: kept[step] for member, kept in self._reports.items()}
            self._of_body[step] = self._body.look(list(self._sides(reports).values()))
        return next((step for step in steps if self._of_body.get(step)), None)

    def take_complete(self) -> list[dict[Member, Reported]]:
        """Take out the reports of all steps for which nothing is missing, in order."""
        complete = []
        while all(self.recorded + 1 in reports for reports in self._reports.values()):
            if self._frames and not self._frames.is_whole(self.recorded + 1, time.monotonic()):
                break
            self.recorded += 1
            complete.append({m: kept.pop(self.recorded) for m, kept in self._reports.items()})
        return complete

    def record(self, reports: Mapping[Member, Reported]) -> None:
        """Record one step, and tell the user what the monitors found at it.

        Raises
        ------
        StorageError
            ``run.h5`` or the recording cannot be written.
        """
        sides = self._sides(reports)
        step = next(iter(reports.values()))[0].step
        self._recorder.add(self._row(step, sides, reports))
        if self._frames is not None:
            self._frames.add(step, {member: report for member, (report, _) in reports.items()})
        for role in sides:
            of_role = [report for who, (report, _) in reports.items() if who[0] == role]
            self._tell(role, [found for report in of_role for found in report.findings], step)
        self._tell("body", self._of_body.pop(step, ()), step)

    def flush(self) -> None:
        """Make sure that what has been recorded is on the disk.

        Raises
        ------
        StorageError
            It cannot be written.
        """
        self._recorder.flush()
        if self._frames is not None:
            self._frames.flush()

    def _row(
        self,
        step: int,
        sides: Mapping[Role, Energies | None],
        reports: Mapping[Member, Reported],
    ) -> dict[str, Array]:
        """Return what is recorded of a step, by its place in ``run.h5``: arrays of one row."""
        whole = self._ledger.add(sides.values())
        row: dict[str, float] = {"/series/step": step, "/series/time": step * self._plan.step}
        row |= {f"/series/total/{field.name}": getattr(whole, field.name) for field in TOTAL_FIELDS}
        for role, side in sides.items():
            for quantity, value in components(side, self._plan.dim).items():
                row[f"/series/{role}/{quantity}"] = value
        columns = {path: np.array([value]) for path, value in row.items()}
        columns["/memory/coupler"] = np.array([[peak_memory()]])
        for role, ranks in self._ranks.items():
            of_role = [reports[role, rank] for rank in range(ranks)]
            columns[f"/memory/{role}"] = np.array([[memory for _, memory in of_role]])
            timings = [report.timings for report, _ in of_role]
            for phase in dict.fromkeys(chain.from_iterable(timings)):
                seconds = [of_rank.get(phase, 0.0) for of_rank in timings]
                columns[f"/timings/{role}/{phase}"] = np.array([seconds])
        return columns

    def _sides(self, reports: Mapping[Member, Reported]) -> dict[Role, Energies | None]:
        """Sum the energies of each side at a step over its ranks."""
        return {
            role: total([reports[role, rank][0].energies for rank in range(ranks)])
            for role, ranks in self._ranks.items()
        }

    def _tell(self, side: Side, findings: Iterable[Finding], step: int) -> None:
        """Tell and record the findings about a side that are the first of their kind."""
        now = step * self._plan.step
        for finding in worst(findings):
            if (side, finding.kind) in self._told:
                continue
            self._told.add((side, finding.kind))
            message = sentence(side, finding, now)
            self.defect = self.defect or message
            self._recorder.add_finding(side, finding, step, now, message)
            log.warning("%s", message)
            self._emit(Found(step, message))

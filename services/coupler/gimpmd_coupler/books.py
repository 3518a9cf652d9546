"""The books of a run: the reports of all ranks, their sums, and what the monitors found.

Reports are entered in the thread of the bus. Steps for which all ranks have reported are recorded
by the main thread, because no rank waits for that.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain, takewhile

import numpy as np

from gimpmd_coupler.body_watch import BodyWatch
from gimpmd_coupler.columns import Columns
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

Reports = Mapping[Member, StepReport]
"""What ranks report of one step; only of ranks that have energies or findings."""


@dataclass(frozen=True)
class Page:
    """Steps for which nothing is missing.

    Attributes
    ----------
    steps : range
    columns : dict of ndarray, shape ``(len(steps), ranks)``
        Timings and memory of all ranks, by their place in ``run.h5``.
    reports : dict by step
        In the order of the ranks; only steps that have some.
    """

    steps: range
    columns: dict[str, Array]
    reports: dict[int, Reports]


class Books:
    """Keeps what the ranks report of each step, and writes complete steps to ``run.h5``.

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
        self._entered = dict.fromkeys(roster.expected, first - 1)  # last step of each rank
        self._columns = Columns(first)
        self._reports: dict[int, dict[Member, StepReport]] = {}  # by step; see `Reports`
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

    def enter(self, member: Member, reports: Sequence[StepReport], memory: int) -> None:
        """Enter reports of a rank about the steps that follow those of its last reports."""
        if not reports:
            return
        (role, rank), ranks = member, self._ranks[member[0]]
        steps = range(reports[0].step, reports[-1].step + 1)
        self._columns.put(f"/memory/{role}", ranks, rank, steps, memory)
        timings = [report.timings for report in reports]
        for phase in dict.fromkeys(chain.from_iterable(timings)):
            seconds = [of_step.get(phase, 0.0) for of_step in timings]
            self._columns.put(f"/timings/{role}/{phase}", ranks, rank, steps, seconds)
        for report in reports:
            if report.energies is not None or report.findings:
                self._reports.setdefault(report.step, {})[member] = report
        self._entered[member] = steps[-1]

    def defect_of_body(self, steps: range) -> int | None:
        """Let the monitor of the whole body look at steps that all ranks have just completed.

        Returns
        -------
        int or None
            The first step at which it found something.
        """
        for step in filter(self._body.looks, steps):
            sides = self._sides(self._reports.get(step, {}))
            if found := self._body.look(list(sides.values())):
                self._of_body[step] = found
        return next((step for step in steps if step in self._of_body), None)

    def take_complete(self) -> Page:
        """Take out the reports of all steps for which nothing is missing."""
        first = self.recorded + 1
        steps = range(first, min(self._entered.values()) + 1)
        if self._frames is not None:
            whole = takewhile(partial(self._frames.is_whole, now=time.monotonic()), steps)
            steps = range(first, first + len(list(whole)))
        self.recorded += len(steps)
        reports = {step: self._reports.pop(step) for step in steps if step in self._reports}
        return Page(
            steps,
            self._columns.take(len(steps)),
            {step: {m: of[m] for m in self._entered if m in of} for step, of in reports.items()},
        )

    def record(self, page: Page) -> None:
        """Record complete steps, and tell the user what the monitors found at them.

        Raises
        ------
        StorageError
            ``run.h5`` or the recording cannot be written.
        """
        memory = {"/memory/coupler": np.full((len(page.steps), 1), peak_memory())}
        self._recorder.add(self._series(page) | memory | page.columns)
        if self._frames is not None:
            for step in page.steps:
                self._frames.add(step, page.reports.get(step, {}))
        for step, reports in page.reports.items():
            for role in self._ranks:
                of_role = [report for who, report in reports.items() if who[0] == role]
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

    def _series(self, page: Page) -> dict[str, Array]:
        """Series of some steps by their place in ``run.h5``: NaN at steps without energies."""
        steps = np.array(page.steps)
        series = {path: np.full(steps.size, value) for path, value in self._row({}).items()}
        for step, reports in page.reports.items():
            for path, value in self._row(reports).items():
                series[path][step - page.steps.start] = value
        return {"/series/step": steps, "/series/time": steps * self._plan.step} | series

    def _row(self, reports: Reports) -> dict[str, float]:
        """Energies of a step by their place in ``run.h5``."""
        sides = self._sides(reports)
        whole = self._ledger.add(sides.values())
        row = {f"/series/total/{field.name}": getattr(whole, field.name) for field in TOTAL_FIELDS}
        for role, side in sides.items():
            for quantity, value in components(side, self._plan.dim).items():
                row[f"/series/{role}/{quantity}"] = value
        return row

    def _sides(self, reports: Reports) -> dict[Role, Energies | None]:
        """Sum the energies of each side at a step over its ranks."""
        return {
            role: total(
                [
                    report.energies if (report := reports.get((role, rank))) else None
                    for rank in range(ranks)
                ]
            )
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

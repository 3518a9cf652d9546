"""Both sides of a case in one process, without coupler and bus: a run in a second or two."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from mpi4py import MPI
from msgspec.structs import replace

from gimpmd_coupler.body_watch import BodyWatch
from gimpmd_gimp.gimp import Gimp
from gimpmd_gimp.side import ContinuumSide
from gimpmd_md.probe import probe
from gimpmd_md.side import MdSide, open_side
from gimpmd_schemas.arrays import Ints
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.resolve import resolve
from gimpmd_schemas.wire.answers import Probe
from gimpmd_schemas.wire.energies import total
from gimpmd_schemas.wire.findings import Finding, Kind, Side, worst
from gimpmd_schemas.wire.plausibility import Gain
from tests.cases import EXAMPLE


@dataclass(frozen=True)
class Made:
    """A finding, on which side and when."""

    side: Side
    time: float
    finding: Finding


@dataclass(frozen=True)
class Story:
    """A case, as plain values, and LAMMPS scripts beside it, by name."""

    case: dict[str, Any]
    scripts: dict[str, str]


def run(story: Story, folder: Path) -> list[Made]:
    """Run a story in an empty folder; return the first finding of each kind on each side.

    An error of a side ends the run: it is no silence.
    """
    with _in_folder(story, folder) as case:
        plan, continuum = _make(case)
        if plan.coupling is None:
            return _alone(continuum, plan)
        return _together(open_side(plan, MPI.COMM_SELF, Path()), continuum, plan)


def gain(story: Story, folder: Path) -> float:
    """Energy that the whole body gains without a source, over the largest one that has one."""
    with _in_folder(story, folder) as case:
        plan, continuum = _make(case)
        md, share = open_side(plan, MPI.COMM_SELF, Path()), Gain(plan)
        for _ in _steps(md, continuum, plan):
            if body := total([md.energies(), continuum.energies()]):
                gained = share.share(replace(body, interface_work=0.0))
        return gained


@contextlib.contextmanager
def _in_folder(story: Story, folder: Path) -> Iterator[Case]:
    """The case, in its folder with its scripts, which is the current one meanwhile."""
    for script in EXAMPLE.glob("*.in"):
        (folder / script.name).write_text(script.read_text())
    for name, text in story.scripts.items():
        (folder / name).write_text(text)
    with contextlib.chdir(folder):
        yield msgspec.convert(story.case, Case)


def _make(case: Case) -> tuple[Plan, ContinuumSide]:
    asked = probe(case, MPI.COMM_SELF) if case.md is not None else Probe()
    plan = resolve(case, asked, Path("case.yaml"))
    Path("fields").mkdir()
    return plan, ContinuumSide(plan, Gimp(plan, None, Path()))


def _alone(continuum: ContinuumSide, plan: Plan) -> list[Made]:
    notes = Notes(plan)
    for step in range(plan.steps + 1):
        continuum.finish()
        if step < plan.steps:
            continuum.advance()
        notes.take("continuum", continuum, step)
    continuum.close()
    return notes.made


def _together(md: MdSide, continuum: ContinuumSide, plan: Plan) -> list[Made]:
    notes, watch = Notes(plan), BodyWatch(plan)
    for step in _steps(md, continuum, plan):
        notes.take("md", md, step)
        notes.take("continuum", continuum, step)
        if watch.looks(step):
            notes.add("body", watch.look([md.energies(), continuum.energies()]), step)
    return notes.made


def _steps(md: MdSide, continuum: ContinuumSide, plan: Plan) -> Iterator[int]:
    """Take both sides to the end; yields each step, when its energies are there."""
    to_continuum = _places(md.offers, continuum.needs)
    to_md = _places(continuum.offers, md.needs)
    for step in range(plan.steps + 1):
        fields = md.zone_fields()
        md.finish()
        continuum.finish()
        continuum.receive({name: value[to_continuum] for name, value in fields.items()})
        if step < plan.steps:
            continuum.advance()
            md.receive({k: value[to_md].copy() for k, value in continuum.zone_fields().items()})
            md.advance()
        yield step
    md.close()
    continuum.close()


class Notes:
    """The first finding of each kind on each side."""

    def __init__(self, plan: Plan) -> None:
        self._step, self._made = plan.step, dict[tuple[Side, Kind], Made]()

    def take(self, role: Side, side: MdSide | ContinuumSide, step: int) -> None:
        """Ask a side for its findings at a step, as the loop of a service does."""
        side.energies()
        self.add(role, side.findings(), step)

    def add(self, side: Side, findings: tuple[Finding, ...], step: int) -> None:
        """Add the findings about a side at a step."""
        for finding in worst(findings):
            made = Made(side, step * self._step, finding)
            self._made.setdefault((side, finding.kind), made)

    @property
    def made(self) -> list[Made]:
        """The findings, in the order of the run."""
        return list(self._made.values())


def _places(offered: Ints, needed: Ints) -> Ints:
    """Rows of the needed nodes among the offered ones."""
    order = np.argsort(offered)
    rows: Ints = order[np.searchsorted(offered, needed, sorter=order)]
    return rows


def told(made: list[Made]) -> Iterator[str]:
    """A line for each finding."""
    for one in made:
        yield f"{one.side}: {one.finding.kind}, t = {one.time:.3g}, {one.finding.value:.3g}"

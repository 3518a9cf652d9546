"""The books of a run: which steps are complete, what is recorded, and what is told."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import h5py
import msgspec
import numpy as np
import pytest

from gimpmd_coupler.books import Books
from gimpmd_coupler.recorder import Recorder
from gimpmd_coupler.roster import Roster
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.wire.events import Event, Found
from gimpmd_schemas.wire.findings import check
from gimpmd_schemas.wire.messages import Member, StepReport
from gimpmd_schemas.wire.plausibility import GAIN
from tests.cases import CASE, changed
from tests.services.coupler.test_body_watch import side

PLAN = make_plan(msgspec.convert(changed(CASE, {"time.end": 8.0}), Case))
MEMBERS: tuple[Member, ...] = Roster("test", PLAN).expected


@pytest.fixture
def told() -> list[Event]:
    return []


@pytest.fixture
def recorder(tmp_path: Path) -> Iterator[Recorder]:
    with Recorder(tmp_path / "run.h5", "", "lj") as recorder:
        yield recorder


@pytest.fixture
def books(recorder: Recorder, told: list[Event]) -> Books:
    return Books(PLAN, Roster("test", PLAN), told.append, recorder, None, None)


def report(step: int, kinetic: float = 1.0, strain: float = 0.0) -> StepReport:
    energies = side(kinetic=kinetic)
    findings = check("strain", strain, 0.1)
    return StepReport(step=step, energies=energies, timings={"advance": 0.5}, findings=findings)


def enter_all(books: Books, *reports: StepReport) -> None:
    for member in MEMBERS:
        books.enter(member, reports, 7)


def test_a_step_is_complete_when_all_ranks_have_reported_it(books: Books) -> None:
    for member in MEMBERS[1:]:
        books.enter(member, [report(0), report(1)], 7)
    assert (books.take_complete().steps, books.recorded) == (range(0), -1)
    books.enter(MEMBERS[0], [report(0)], 7)
    page = books.take_complete()
    assert (page.steps, list(page.reports), books.recorded) == (range(1), [0], 0)
    assert list(page.reports[0]) == list(MEMBERS)
    books.enter(MEMBERS[0], [report(1)], 7)
    assert books.take_complete().steps == range(1, 2)


def test_what_ranks_report_does_not_depend_on_the_order(books: Books, recorder: Recorder) -> None:
    """Reports of several steps, with other phases at each of them, and energies at some."""
    plain = [StepReport(step=k, energies=None, timings={"a": k, "b": 1.0}) for k in range(1, 5)]
    plain[2] = StepReport(step=3, energies=None, timings={"b": 2.0, "c": 3.0})
    for member in reversed(MEMBERS):
        books.enter(member, [report(0), *plain[:2]], 7)
    books.record(books.take_complete())
    for member in MEMBERS:
        books.enter(member, [*plain[2:], report(5)], 8)
    books.record(books.take_complete())
    books.flush()
    with h5py.File(recorder.path) as file:
        assert file["series/step"][:].tolist() == list(range(6))
        known = np.isfinite(file["series/total/energy"])
        assert known.tolist() == [True, False, False, False, False, True]
        for role in PLAN.roles:
            seconds = {phase: rows[:] for phase, rows in file[f"timings/{role}"].items()}
            for rank in range(PLAN.ranks(role)):
                assert seconds["a"][:, rank].tolist() == [0.0, 1.0, 2.0, 0.0, 4.0, 0.0]
                assert seconds["b"][:, rank].tolist() == [0.0, 1.0, 1.0, 2.0, 1.0, 0.0]
                assert seconds["c"][:, rank].tolist() == [0.0, 0.0, 0.0, 3.0, 0.0, 0.0]
                assert file[f"memory/{role}"][:, rank].tolist() == [7, 7, 7, 8, 8, 8]


def test_sums_over_ranks_are_recorded(books: Books, recorder: Recorder) -> None:
    enter_all(books, report(0, kinetic=2.0))
    books.record(books.take_complete())
    books.flush()
    role, rank = MEMBERS[-1]
    with h5py.File(recorder.path) as file:
        of_role = [member for member in MEMBERS if member[0] == role]
        assert file[f"series/{role}/kinetic"][:] == [2.0 * len(of_role)]
        assert file["series/total/energy"][:] == [2.0 * len(MEMBERS)]
        assert file[f"timings/{role}/advance"][:, rank] == [0.5]
        assert file[f"memory/{role}"][:, rank] == [7]
    assert books.start_energy == 2.0 * len(MEMBERS)


def test_a_finding_is_told_once(books: Books, told: list[Event], recorder: Recorder) -> None:
    enter_all(books, report(0), report(1, strain=0.2), report(2, strain=0.3))
    books.record(books.take_complete())
    found = [event for event in told if isinstance(event, Found)]
    assert [event.step for event in found] == [1, 1]  # one of each side
    assert books.defect == found[0].message
    assert list(recorder.told().values()) == [event.message for event in found]


def test_the_first_step_at_which_the_whole_body_gains_energy(books: Books) -> None:
    looks = (0, 20, 40)
    for step, kinetic in zip(looks, (1.0, 1.0 + 0.9 * GAIN, 1.0 + 1.1 * GAIN), strict=True):
        enter_all(books, report(step, kinetic=kinetic))
    assert [books.defect_of_body(range(step, step + 1)) for step in looks] == [None, None, 40]

"""The loop of a service: the order of its calls, and what it reports."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gimpmd_coupler.loop import Timings, run_service
from gimpmd_coupler.participant import Incoming
from gimpmd_schemas.checkpoint.states import SavedStates
from gimpmd_schemas.errors import GimpmdError
from gimpmd_schemas.wire.energies import Energies
from gimpmd_schemas.wire.findings import Finding, check

AT_REST = Energies(
    kinetic=0.0,
    potential=0.0,
    external_work=0.0,
    interface_work=0.0,
    dissipated=0.0,
    mass=1.0,
    momentum=(0.0, 0.0),
)


class Recorded:
    """A side that notes its calls."""

    offers, needs, notes = np.arange(3), np.arange(2), ()

    def __init__(self, calls: list[Any]) -> None:
        self.calls = calls
        self.timings = Timings()
        self.step = 0

    def zone_fields(self) -> dict[str, np.ndarray]:
        self.calls.append("zone_fields")
        return {"velocity": np.full((3, 2), float(self.step))}

    def finish(self) -> None:
        self.calls.append("finish")

    def write(self, time: float) -> None:
        self.calls.append(("write", time))

    def receive(self, fields: Mapping[str, np.ndarray]) -> None:
        self.calls.append(("receive", *fields))

    def advance(self) -> None:
        self.step += 1
        self.calls.append("advance")

    def energies(self) -> Energies | None:
        self.calls.append("energies")
        return AT_REST if self.step % 2 == 0 else None

    def findings(self) -> tuple[Finding, ...]:
        return check("atoms", self.step, 1.0)

    def renew(self) -> None:
        self.calls.append("renew")

    def state(self) -> Mapping[str, np.ndarray]:
        self.calls.append("state")
        return {"x": np.arange(3.0)}

    def close(self) -> None:
        """Nothing is open."""


class Coupler:
    """A participant that is told to stop at step 2."""

    member = ("md", 0)

    def __init__(self, calls: list[Any], checkpoints: tuple[int, ...] = ()) -> None:
        self.calls, self.checkpoints = calls, checkpoints
        self.reports: list[tuple[Energies | None, int]] = []

    def register(
        self, offers: np.ndarray, needs: np.ndarray, notes: tuple, first_step: int
    ) -> SimpleNamespace:
        self.calls.append(("register", offers.size, needs.size))
        self.step = first_step
        return SimpleNamespace(first_step=first_step, last_step=2)

    def must_save(self) -> bool:
        return self.step in self.checkpoints

    def note_saved(self, digest: str) -> None:
        self.calls.append(("saved", self.step))

    def exchange(
        self,
        step: int,
        time: float,
        fields: Mapping[str, np.ndarray],
        meanwhile: Callable[[], None] | None,
    ) -> Incoming:
        self.step = step
        self.calls.append(("exchange", step, time, float(fields["velocity"][0, 0])))
        if meanwhile is not None:
            meanwhile()
        return Incoming("stop", {}) if step == 2 else Incoming("advance", {"force": fields})

    def report(
        self,
        energies: Energies | None,
        timings: Mapping[str, float],
        findings: tuple[Finding, ...],
    ) -> None:
        self.calls.append(("report", *timings))
        self.reports.append((energies, len(findings)))


def plan(*renewals: int) -> Any:
    """A plan with output at every other step."""
    return SimpleNamespace(
        step=0.5, is_output=lambda step: step % 2 == 0, renews=lambda step: step in renewals
    )


def test_order_of_calls(tmp_path: Path) -> None:
    calls: list[Any] = []
    participant = Coupler(calls)
    run_service(Recorded(calls), plan(), participant, tmp_path)
    assert calls == [
        ("register", 3, 2),
        *("zone_fields", ("exchange", 0, 0.0, 0.0), "finish", ("write", 0.0)),
        *(("receive", "force"), "advance", "energies", ("report", "output")),
        *("zone_fields", ("exchange", 1, 0.5, 1.0), "finish"),
        *(("receive", "force"), "advance", "energies", ("report",)),
        *("zone_fields", ("exchange", 2, 1.0, 2.0), "finish", ("write", 1.0)),
        *(("receive",), "energies", ("report", "output")),
    ]
    assert participant.reports == [(None, 0), (AT_REST, 1), (AT_REST, 1)]


def test_a_state_is_renewed_and_saved_before_the_fields_are_taken(tmp_path: Path) -> None:
    calls: list[Any] = []
    run_service(Recorded(calls), plan(1), Coupler(calls, checkpoints=(2,)), tmp_path)
    ends = [calls[i + 1 : i + 5] for i, call in enumerate(calls) if call == "finish"]
    assert ends[1][:2] == ["renew", ("receive", "force")], "renewed, not saved"
    assert ends[2] == [("write", 1.0), "renew", "state", ("saved", 2)]
    (path,) = tmp_path.rglob("*.h5")
    assert path == tmp_path / "checkpoints" / "2" / "md.0.h5"


def test_a_run_goes_on_with_the_step_that_was_finished(tmp_path: Path) -> None:
    calls: list[Any] = []
    side = Recorded(calls)
    side.step = 1
    saved = SavedStates(1, (tmp_path / "md.0.h5",), 0, 1)
    run_service(side, plan(1), Coupler(calls, checkpoints=(1,)), tmp_path, saved)
    assert calls[1:5] == [
        *("zone_fields", ("exchange", 1, 0.5, 1.0), ("receive", "force"), "advance"),
    ]


def test_a_state_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    (tmp_path / "checkpoints").write_text("in the way")
    with pytest.raises(GimpmdError, match=r"cannot save the checkpoint of step 1: .*checkpoints"):
        run_service(Recorded([]), plan(), Coupler([], checkpoints=(1,)), tmp_path)


def test_timings_add_up_and_start_again_at_zero() -> None:
    timings = Timings()
    for _ in range(2):
        with timings.phase("step"):
            time.sleep(0.01)
    with timings.phase("output"):
        pass
    taken = timings.take()
    assert list(taken) == ["step", "output"]
    assert taken["step"] >= 0.02
    assert timings.take() == {}

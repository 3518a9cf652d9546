"""The loop of a service: the order of its calls, and what it reports."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np

from gimpmd_coupler.loop import Timings, run_service
from gimpmd_coupler.participant import Incoming
from gimpmd_schemas.wire.broken_bonds import BrokenBonds
from gimpmd_schemas.wire.energies import Energies

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

    def broken_bonds(self) -> BrokenBonds | None:
        return BrokenBonds(count=self.step)

    def close(self) -> None:
        """Nothing is open."""


class Coupler:
    """A participant that is told to stop at step 2."""

    def __init__(self, calls: list[Any]) -> None:
        self.calls = calls
        self.reports: list[tuple[Energies | None, int]] = []

    def register(self, offers: np.ndarray, needs: np.ndarray, notes: tuple) -> SimpleNamespace:
        self.calls.append(("register", offers.size, needs.size))
        return SimpleNamespace(first_step=0, last_step=2)

    def exchange(
        self,
        step: int,
        time: float,
        fields: Mapping[str, np.ndarray],
        meanwhile: Callable[[], None],
    ) -> Incoming:
        self.calls.append(("exchange", step, time, float(fields["velocity"][0, 0])))
        meanwhile()
        return Incoming("stop", {}) if step == 2 else Incoming("advance", {"force": fields})

    def report(
        self,
        energies: Energies | None,
        timings: Mapping[str, float],
        broken_bonds: BrokenBonds | None,
    ) -> None:
        self.calls.append(("report", *timings))
        self.reports.append((energies, broken_bonds.count))


def test_order_of_calls() -> None:
    calls: list[Any] = []
    participant = Coupler(calls)
    plan = SimpleNamespace(step=0.5, is_output=lambda step: step % 2 == 0)
    run_service(Recorded(calls), plan, participant)
    assert calls == [
        ("register", 3, 2),
        *("zone_fields", ("exchange", 0, 0.0, 0.0), "finish", ("write", 0.0)),
        *(("receive", "force"), "advance", "energies", ("report", "output")),
        *("zone_fields", ("exchange", 1, 0.5, 1.0), "finish"),
        *(("receive", "force"), "advance", "energies", ("report",)),
        *("zone_fields", ("exchange", 2, 1.0, 2.0), "finish", ("write", 1.0)),
        *(("receive",), "energies", ("report", "output")),
    ]
    assert participant.reports == [(None, 1), (AT_REST, 2), (AT_REST, 2)]


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

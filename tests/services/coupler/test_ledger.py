"""Sums and balance."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimpmd_coupler.ledger import QUANTITIES, Ledger

REPORT = st.fixed_dictionaries({q: st.floats(-1e6, 1e6) for q in QUANTITIES})


def report(kinetic: float = 0.0, potential: float = 0.0, work: float = 0.0) -> dict[str, float]:
    return {"kinetic": kinetic, "potential": potential, "external_work": work}


def test_from_rest_the_balance_is_the_papers() -> None:
    ledger = Ledger()
    assert ledger.enter({"md": [report()], "continuum": [report()]}).balance == 0.0
    entry = ledger.enter({"md": [report(1.0, 2.0, 3.0)], "continuum": [report(2.0, 3.5, 7.0)]})
    assert entry.energy == 8.5
    assert entry.external_work == 10.0
    assert entry.balance == pytest.approx((10.0 - 8.5) / 10.0)


def test_without_work_the_balance_is_relative_to_the_energy_at_the_start() -> None:
    ledger = Ledger()
    ledger.enter({"md": [report(3.0, 1.0)]})
    assert ledger.enter({"md": [report(2.0, 1.0)]}).balance == pytest.approx(0.25)


@given(st.lists(REPORT, min_size=1, max_size=8), st.randoms())
def test_the_order_of_ranks_does_not_matter(ranks: list[dict[str, float]], random: object) -> None:
    shuffled = list(ranks)
    random.shuffle(shuffled)
    assert Ledger().enter({"md": ranks}).sides == Ledger().enter({"md": shuffled}).sides


def test_sums_do_not_lose_small_ranks() -> None:
    ranks = [report(1e16), report(1.0), report(-1e16)]
    assert Ledger().enter({"md": ranks}).sides["md"]["kinetic"] == 1.0


def test_a_side_without_report_leaves_the_step_open():
    """Levels of the grid stand together every few steps; in between there is no energy to give."""
    ledger = Ledger()
    ledger.enter({"md": [{"kinetic": 1.0}], "continuum": [{"kinetic": 2.0}]})
    open_step = ledger.enter({"md": [{"kinetic": 1.0}], "continuum": [{}, {}]})
    assert math.isnan(open_step.energy)
    assert math.isnan(open_step.balance)
    assert open_step.sides["md"]["kinetic"] == 1.0
    after = ledger.enter({"md": [{"kinetic": 1.5}], "continuum": [{"kinetic": 1.5}]})
    assert after.energy == 3.0
    assert after.balance == 0.0

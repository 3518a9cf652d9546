"""Registrations against the plan, without a bus."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import pytest

from gimpmd_coupler.roster import Roster
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import Plan, make_plan
from gimpmd_schemas.errors import ProtocolError, RefusedError
from gimpmd_schemas.wire.messages import PROTOCOL_VERSION, Register, Report
from tests.services.coupler.conftest import CASE

PLAN: Plan = make_plan(msgspec.convert(CASE, Case))


def register(role: str = "md", rank: int = 0, **changes: Any) -> Register:
    fields = {
        "protocol": PROTOCOL_VERSION,
        "run": "test",
        "plan": PLAN.digest(),
        "role": role,
        "rank": rank,
        "ranks": PLAN.ranks(role),
        "backend": "test",
        "units": "lj",
        "dt": PLAN.step,
        "patch": PLAN.domain.box,
        "host": "here",
        "pid": 1,
    }
    return Register(**(fields | changes))


def ids(offers: range, needs: range) -> dict[str, np.ndarray]:
    return {"offers": np.array(offers, np.int64), "needs": np.array(needs, np.int64)}


def full() -> Roster:
    """Two ranks of atoms that offer five nodes each, and a continuum that needs some of them."""
    roster = Roster("test", PLAN)
    roster.enter(register("md", 0), ids(range(5), range(100, 103)))
    roster.enter(register("md", 1), ids(range(5, 10), range(0)))
    roster.enter(register("continuum"), ids(range(100, 110), range(3, 7)))
    return roster


def test_all_ranks_of_the_plan_are_expected() -> None:
    roster = Roster("test", PLAN)
    assert roster.missing() == [("md", 0), ("md", 1), ("continuum", 0)]
    assert full().missing() == []


def test_links_lead_to_the_ranks_that_offer_what_is_needed() -> None:
    def plain(member: Any) -> dict[int, tuple[list[int], list[int]]]:
        found = full().links(member)
        return {rank: (link.rows.tolist(), link.places.tolist()) for rank, link in found.items()}

    assert plain(("continuum", 0)) == {0: ([3, 4], [0, 1]), 1: ([0, 1], [2, 3])}
    assert plain(("md", 0)) == {0: ([0, 1, 2], [0, 1, 2])}
    assert plain(("md", 1)) == {}


def test_a_run_of_one_side_has_no_links() -> None:
    plan = make_plan(msgspec.convert(CASE | {"only": "md"}, Case))
    roster = Roster("test", plan)
    for rank in range(2):
        roster.enter(register(rank=rank, plan=plan.digest()), ids(range(5), range(5)))
    assert roster.links(("md", 0)) == {}


def test_a_repeated_registration_changes_nothing_and_another_process_is_refused() -> None:
    roster = full()
    assert roster.enter(register("md", 0), ids(range(5), range(100, 103))) == ("md", 0)
    with pytest.raises(RefusedError, match="md/0 is already taken by process 1 on here"):
        roster.enter(register("md", 0, pid=2), ids(range(5), range(0)))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"protocol": 1}, "protocol version differs"),
        ({"run": "other"}, "run id differs"),
        ({"ranks": 3}, "number of md ranks differs: the coupler has 2, the service 3"),
        ({"rank": 2}, "rank 2 of md is out of range: ranks 0 to 1 take part"),
        ({"units": "metal"}, "unit style differs: the coupler has 'lj', the service 'metal'"),
        ({"dt": 0.04}, "coupling time step differs: the coupler has .*, the service 0.04"),
        ({"plan": "other"}, "plan digest differs: the coupler has '.*', the service 'other'"),
    ],
)
def test_what_does_not_fit_the_plan_is_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(RefusedError, match=said):
        Roster("test", PLAN).enter(register(**changes), ids(range(5), range(0)))


def test_a_role_that_does_not_take_part_is_refused() -> None:
    alone = make_plan(msgspec.convert(CASE | {"only": "continuum"}, Case))
    with pytest.raises(RefusedError, match="role 'md' has no part in a run of 'continuum' only"):
        Roster("test", alone).enter(register(ranks=2), ids(range(5), range(0)))


def test_malformed_node_lists_break_the_protocol() -> None:
    with pytest.raises(ProtocolError, match="'needs' must be int64"):
        Roster("test", PLAN).enter(register(), {"offers": np.arange(3)})


def test_a_report_must_come_from_a_registered_rank() -> None:
    report = Report(role="md", rank=0, steps=(), peak_memory=1)
    assert full().check_report(report) == ("md", 0)
    with pytest.raises(RefusedError, match="md/0 reports before it has registered"):
        Roster("test", PLAN).check_report(report)

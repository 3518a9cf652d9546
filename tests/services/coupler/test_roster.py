"""Registrations against the plan, without a bus."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import pytest

from gimpmd_coupler.rendezvous import SERIAL
from gimpmd_coupler.roster import Roster
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import Plan, make_plan
from gimpmd_schemas.errors import ProtocolError, RefusedError
from gimpmd_schemas.wire.messages import PROTOCOL_VERSION, Exchange, Register
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


def test_maps_join_the_offers_of_all_ranks() -> None:
    maps = full().maps(SERIAL)
    assert maps["continuum", 0].tolist() == [3, 4, 5, 6]
    assert maps["md", 0].tolist() == [0, 1, 2]
    assert maps["md", 1].tolist() == []


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
        ({"units": "metal"}, "unit style differs"),
        ({"dt": 0.04}, "coupling time step differs"),
        ({"plan": "other"}, "plan digest differs"),
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


def test_a_part_must_come_from_a_registered_rank_with_the_same_plan() -> None:
    part = Exchange(
        protocol=PROTOCOL_VERSION,
        run="test",
        plan=PLAN.digest(),
        role="md",
        rank=0,
        step=0,
        time=0.0,
        report=None,
    )
    assert full().refuse_stranger(part) == ("md", 0)
    with pytest.raises(RefusedError, match="exchanges before it has registered"):
        Roster("test", PLAN).refuse_stranger(part)
    with pytest.raises(RefusedError, match="plan digest differs"):
        full().refuse_stranger(msgspec.structs.replace(part, plan="other"))

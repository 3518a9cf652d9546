"""Grants: how far ranks may go, and where the run ends."""

from __future__ import annotations

import random

import pytest

from gimpmd_coupler.grants import AHEAD_SECONDS, FEWEST, Grants
from gimpmd_schemas.errors import ProtocolError
from gimpmd_schemas.wire.messages import Grant

MD, CONTINUUM = ("md", 0), ("continuum", 0)


def grants(last: int = 1000, reach: int | None = None) -> Grants:
    return Grants((MD, CONTINUUM), 0, last, now=0.0, reach=reach)


def test_nobody_goes_beyond_the_slowest_by_more_than_the_grant() -> None:
    some = grants()
    assert some.granted == FEWEST - 1
    some.report(MD, [0], 1e-3)
    assert some.granted == FEWEST - 1, "the continuum has not reported"
    some.report(CONTINUUM, [0], 2e-3)
    assert some.granted == FEWEST + some.done


def test_a_grant_reaches_about_a_second_ahead() -> None:
    some = grants()
    for step in range(400):  # 200 steps a second
        for member in (MD, CONTINUUM):
            some.report(member, [step], step / 200)
    assert some.granted - some.done == pytest.approx(200 * AHEAD_SECONDS, rel=0.05)


def test_a_rank_is_answered_when_it_may_advance_or_the_run_ends() -> None:
    some = grants()
    some.report(MD, [0], 0.1)  # stands at step 1, which is granted, and waits to advance to 2
    assert not some.may_go_on(MD)
    assert some.may_go_on(CONTINUUM)
    some.stop()
    assert some.may_go_on(MD)


def test_repeated_steps_are_not_new() -> None:
    some = grants(reach=10)
    assert some.report(MD, [0, 1], 0.0) == range(2)
    assert some.report(MD, [0, 1], 0.0) == range(0)
    assert some.report(MD, [1, 2], 0.0) == range(2, 3)
    assert some.report(MD, [], 0.0) == range(0)


@pytest.mark.parametrize(("steps", "reason"), [([1], "after step -1"), ([0, 2], "after step -1")])
def test_steps_follow_one_another(steps: list[int], reason: str) -> None:
    some = grants()
    with pytest.raises(ProtocolError, match=reason):
        some.report(MD, steps, 0.0)
    assert some.reported[MD] == -1


def test_a_step_beyond_the_grant_is_refused() -> None:
    with pytest.raises(ProtocolError, match="may go to step 1 only"):
        grants().report(MD, [0, 1, 2], 0.0)


def test_ranks_that_wait_for_ranks_which_stay_are_set_free() -> None:
    """Of three ranks two stay at step 7; the third may stand two steps further at most."""
    ranks = [("continuum", k) for k in range(3)]
    some = Grants((MD, *ranks), 0, 1000, now=0.0, reach=20, together=4)
    for member in (MD, *ranks):
        some.report(member, list(range(6)), 0.1)
    some.stop()
    some.report(ranks[0], [6], 0.2, holds=7)
    some.report(ranks[1], [6], 0.2, holds=7)
    assert not some.settle(), "the atoms are merely slow"
    some.report(MD, [6, 7], 0.2, holds=8)
    assert some.recalling
    assert some.settle()
    assert (some.last, some.granted, some.recalling) == (12, 12, False)  # 8 + 2, then all levels
    assert some.may_go_on(ranks[0])
    some.report(ranks[2], [6, 7], 0.3, holds=8)  # it learns of the end with the answer
    assert some.may_go_on(ranks[2])
    assert not some.settle()


def test_a_stop_takes_grants_back_and_ends_the_run_at_the_farthest_rank() -> None:
    some = grants(reach=10)
    some.report(MD, [0, 1, 2, 3], 0.1)
    some.stop()
    assert some.grant().recall
    some.report(MD, [4], 0.1)  # sent before it learned of the stop
    assert some.may_go_on(MD)
    some.report(MD, [], 0.2, holds=5)
    assert not some.may_go_on(MD)
    assert some.may_go_on(CONTINUUM)
    some.report(CONTINUUM, [0, 1, 2, 3], 0.2, holds=4)
    assert some.grant() == Grant(granted=5, last=5, done=3)
    assert not some.finished()
    for member in (MD, CONTINUUM):
        assert some.may_go_on(member)
        some.report(member, list(range(some.reported[member] + 1, 6)), 0.2)
    assert some.finished()
    some.stop()
    assert not some.grant().recall, "nobody is left who could answer"


@pytest.mark.parametrize("holds", [3, 11])
def test_a_rank_can_only_stay_where_it_may_stand(holds: int) -> None:
    some = grants(reach=10)
    some.report(MD, [0, 1, 2, 3, 4], 0.1)
    some.stop()
    with pytest.raises(ProtocolError, match=f"stays at step {holds}"):
        some.report(MD, [], 0.2, holds=holds)


@pytest.mark.parametrize("seed", range(20))
def test_random_runs(seed: int) -> None:
    """However ranks take turns, all complete the same steps, and a stop comes at once."""
    chance = random.Random(seed)
    members = [("md", k) for k in range(3)] + [("continuum", k) for k in range(2)]
    some = Grants(members, 0, 60, now=0.0)
    told = dict.fromkeys(members, some.grant())  # what each rank knows
    completed = dict.fromkeys(members, -1)
    now, stop_at, farthest = 0.0, chance.choice([None, chance.uniform(0.0, 2.0)]), 60
    while not some.finished():
        now += chance.expovariate(100.0)
        if stop_at is not None and now > stop_at:
            some.stop()
            stop_at, farthest = None, max(completed.values()) + 1 + 5
        member, holds = chance.choice(members), None
        known = told[member]
        if known.recall:
            holds = min(completed[member] + 1, known.last)
        else:
            ahead = known.granted if known.granted == known.last else known.granted - 1
            completed[member] = min(completed[member] + chance.randint(0, 5), ahead)
        steps = list(range(some.reported[member] + 1, completed[member] + 1))
        some.report(member, steps, now, holds=holds)
        if some.may_go_on(member):
            told[member] = some.grant()
        assert some.granted >= max(some.reported.values())
        assert some.done <= some.granted <= some.last
        assert now < 1e3
    assert set(some.reported.values()) == {some.last}
    assert some.last <= farthest


@pytest.mark.parametrize("reach", [FEWEST, 7])
@pytest.mark.parametrize("seed", range(10))
def test_a_defect_ends_the_run_at_the_same_step_whatever_the_order(reach: int, seed: int) -> None:
    """Bonds of md/0 break at step 23, those of md/1 at step 21, whoever reports first."""
    chance, broken = random.Random(seed), {("md", 0): 23, ("md", 1): 21}
    members = [*broken, CONTINUUM]
    some = Grants(members, 0, 60, now=0.0, reach=reach)
    while not some.finished():
        member = chance.choice(members)
        ahead = some.granted if some.granted == some.last else some.granted - 1
        steps = list(range(some.reported[member] + 1, ahead + 1))[: chance.randint(0, 5)]
        defect = next((k for k in steps if k >= broken.get(member, 60)), None)
        some.report(member, steps, 0.0, defect)
        assert max(some.reported.values()) <= some.granted <= some.last
    assert some.last == 21 + reach - 1


def test_a_checkpoint_is_ordered_where_no_rank_has_been() -> None:
    some = grants(reach=10)
    some.report(MD, [0, 1, 2, 3], 0.1)
    some.report(CONTINUUM, [0, 1, 2], 0.1)
    assert some.granted == 12
    assert some.order_checkpoint(every=5) == 15
    assert some.grant().checkpoints == (15,)


def test_a_step_at_which_all_ranks_must_stop_can_be_a_checkpoint() -> None:
    some = grants(reach=10)
    some.report(MD, [0], 0.1)
    some.report(CONTINUUM, [0], 0.1)
    assert some.order_checkpoint(every=5) == some.granted == 10


def test_there_is_a_checkpoint_at_the_end_in_place_of_one_beyond() -> None:
    some = Grants((MD,), 0, 12, 0.0, reach=10, saves=True)
    assert some.grant().checkpoints == ()
    some.report(MD, [0, 1, 2], 0.1)
    assert some.granted == some.last
    assert some.order_checkpoint(every=5) is None
    assert some.grant().checkpoints == (12,)


def test_a_stop_ends_the_run_when_all_levels_stand() -> None:
    some = Grants((MD,), 0, 1000, 0.0, reach=10, together=4, saves=True)
    some.report(MD, [0], 0.1)
    some.stop()
    assert some.grant().checkpoints == ()
    assert some.order_checkpoint(every=4) is None
    some.report(MD, [], 0.2, holds=5)
    assert some.grant() == Grant(granted=8, last=8, done=0, checkpoints=(8,))


def test_a_run_that_goes_on_starts_at_its_checkpoint() -> None:
    some = Grants((MD,), 40, 1000, 0.0, reach=10)
    assert (some.done, some.granted) == (39, 49)
    assert some.report(MD, [40], 0.1) == range(40, 41)

"""Who is the culprit, and when we know."""

from __future__ import annotations

from gimpmd_coupler.losses import COLLECT_SECONDS, Losses

A, B = ("md", 0), ("md", 1)


def test_the_first_to_go_is_the_culprit() -> None:
    losses = Losses(lambda member: False, 2.0)
    losses.down(B, 10.0)
    losses.down(A, 10.001)
    assert losses.culprit(10.0) is None  # a last report may still be on its way
    assert losses.culprit(10.0 + COLLECT_SECONDS) == B


def test_a_process_that_runs_may_connect_again() -> None:
    losses = Losses(lambda member: True, 2.0)
    losses.down(A, 10.0)
    assert losses.culprit(11.9) is None
    losses.up(A)
    assert losses.culprit(20.0) is None
    assert losses.next_due(20.0) == float("inf")


def test_a_process_that_runs_but_does_not_come_back_is_lost() -> None:
    losses = Losses(lambda member: True, 2.0)
    losses.down(A, 10.0)
    assert losses.culprit(12.0) == A


def test_a_dead_process_comes_before_one_whose_link_is_down() -> None:
    losses = Losses(lambda member: member == A, 2.0)
    losses.down(A, 10.0)
    losses.down(B, 10.5)
    assert losses.first_dead() == B
    assert losses.culprit(10.6) == B


def test_while_somebody_is_down_we_look_again_soon() -> None:
    losses = Losses(lambda member: True, 2.0)
    losses.down(A, 10.0)
    assert 10.0 < losses.next_due(10.0) < 10.0 + COLLECT_SECONDS

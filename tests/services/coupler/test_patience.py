"""The stages of waiting."""

from __future__ import annotations

from gimpmd_coupler.patience import Patience, Stage


def test_stages_fall_due_once_each_and_in_order() -> None:
    patience = Patience(2.0, 100.0)
    seen = [(t, stage) for t in range(100, 140) if (stage := patience.due(t))]
    assert seen == [(102, Stage.SAY), (106, Stage.DIAGNOSE), (120, Stage.FAIL)]
    assert patience.next_due() == float("inf")


def test_progress_begins_anew() -> None:
    patience = Patience(2.0, 100.0)
    assert patience.due(103.0) is Stage.SAY
    patience.restart(5.0, 104.0)
    assert patience.waited(106.0) == 2.0
    assert patience.due(108.9) is None
    assert patience.due(109.0) is Stage.SAY

"""How results of checks are noted."""

from __future__ import annotations

import pytest

from gimpmd_coupler.check.log import GroupEndedError, Log, expect
from gimpmd_schemas.wire.conformance import Checked


def test_a_check_passes_with_what_it_has_measured() -> None:
    told: list[Checked] = []
    log = Log("course", told.append)
    with log.checking("keeps its mass"):
        log.measure("1e-16 off")
    with log.checking("keeps its energy"):
        expect(True, "nothing", "nothing")
    assert told == [
        Checked(group="course", what="keeps its mass", passed=True, came="1e-16 off"),
        Checked(group="course", what="keeps its energy", passed=True),
    ]


def test_a_failed_check_ends_its_group() -> None:
    told: list[Checked] = []
    log = Log("course", told.append)
    with pytest.raises(GroupEndedError), log.on_the_way(), log.checking("keeps its mass"):
        expect(False, "the mass 1", "the mass 2")
    assert told == [
        Checked(
            group="course",
            what="keeps its mass",
            passed=False,
            expected="the mass 1",
            came="the mass 2",
        )
    ]


def test_a_failure_before_the_first_check_is_noted_too() -> None:
    told: list[Checked] = []
    log = Log("silence", told.append)
    with pytest.raises(GroupEndedError), log.on_the_way():
        expect(False, "a registration", "nothing")
    assert [(one.group, one.passed, one.came) for one in told] == [("silence", False, "nothing")]


def test_a_check_that_is_not_made_has_a_reason() -> None:
    told: list[Checked] = []
    Log("rotation", told.append).leave_out("rotates", "there is no case")
    assert told == [Checked(group="rotation", what="rotates", passed=None, came="there is no case")]

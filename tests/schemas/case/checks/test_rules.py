"""Rules collect the problems of a case."""

from __future__ import annotations

from gimpmd_schemas.case.checks.rules import Rules
from gimpmd_schemas.errors import Problem


def test_rules_that_do_not_hold_are_problems_in_order() -> None:
    rules = Rules()
    assert rules.require(True, "a", 1, "never said")
    assert not rules.require(False, "b", 2, "is odd", "give an even number")
    assert not rules.require(False, "c", None, "is missing")
    assert rules.problems == [
        Problem("b", 2, "is odd", "give an even number"),
        Problem("c", None, "is missing"),
    ]

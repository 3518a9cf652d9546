"""What counts as a failure in the table of checks."""

from __future__ import annotations

from typing import Any

import pytest

from gimpmd_schemas.wire.conformance import Checked
from tests.conformance.__main__ import judged
from tests.conformance.services import Asked

PASSED = Checked(group="course", what="keeps its mass", passed=True)
FAILED = Checked(group="course", what="ends", passed=False, expected="code 0", came="code 1")
REFUSED = Checked(group="course", what="all checks", passed=None, came="it refuses levels")
SAID = "error: a.yaml: 1 problem\n  - md.backend = 'x': is unknown\n"


@pytest.mark.parametrize(
    ("code", "body", "exit_code", "results", "said", "failed"),
    [
        ("gimp", "", 0, [PASSED], "", 0),
        ("gimp", "levels", 3, [PASSED, FAILED], "", 1),
        ("gimp", "levels", 0, [REFUSED], "", 1),  # it must know them
        ("fem", "levels", 0, [REFUSED], "", 0),
        ("fem", "space", 2, [], SAID, 0),
        ("fem", "", 2, [], SAID, 1),
        ("fem", "space", 3, [], "error: the check has crashed", 1),
        ("fem", "levels", 3, [PASSED, FAILED], "", 1),
    ],
)
def test_refusals_are_failures_of_those_who_must_pass(
    code: str, body: str, exit_code: int, results: list[Any], said: str, failed: int
) -> None:
    line, failures = judged(Asked(code, body, []), exit_code, results, said)
    assert len(failures) == failed
    assert line.startswith(f"| {code}")


def test_the_reason_of_a_refusal_is_in_the_table() -> None:
    line, _ = judged(Asked("fem", "space", []), 2, [], SAID)
    assert line == "| fem, space | 0 | 0 | 0 | 0 | md.backend = 'x': is unknown |"

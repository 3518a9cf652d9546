"""What errors say, and the exit code that a process ends with."""

from __future__ import annotations

import pytest

from gimpmd_schemas.errors import (
    BackendError,
    GimpmdError,
    InputError,
    PeerLostError,
    Problem,
    ProtocolError,
    RefusedError,
)


def test_a_problem_names_key_value_and_the_way_out() -> None:
    problem = Problem("grid.cell", -2, "is not positive", "give a length")
    assert str(problem) == "grid.cell = -2: is not positive\n      give a length"
    assert str(Problem("md", None, "is missing")) == "md: is missing"


def test_long_values_are_shortened() -> None:
    said = str(Problem("md.variables", {f"name{n}": "x" * 500 for n in range(99)}, "is wrong"))
    assert len(said) < 600
    assert "..." in said


def test_all_problems_are_listed_under_the_file() -> None:
    problems = [Problem("a", 1, "is wrong"), Problem("b", "two", "is wrong as well")]
    assert str(InputError("case.yaml", problems)) == (
        "case.yaml: 2 problems\n  - a = 1: is wrong\n  - b = 'two': is wrong as well"
    )
    one = InputError("case.yaml", problems[:1])
    assert str(one).startswith("case.yaml: 1 problem\n")
    assert (one.file, one.problems) == ("case.yaml", problems[:1])


@pytest.mark.parametrize(
    ("kind", "code"),
    [
        (GimpmdError, 3),
        (InputError, 2),
        (BackendError, 2),
        (ProtocolError, 3),
        (RefusedError, 3),
        (PeerLostError, 3),
    ],
)
def test_exit_codes(kind: type[GimpmdError], code: int) -> None:
    assert kind.exit_code == code
    assert issubclass(kind, GimpmdError)

"""The program of a continuum service in any language."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from gimpmd_schemas.case.derive.program import program, with_program
from gimpmd_schemas.case.form import Case


@pytest.fixture
def built(tmp_path: Path) -> Path:
    """A program in a folder beside the case."""
    path = tmp_path / "target" / "solid"
    path.parent.mkdir()
    path.write_text("#!/bin/sh\n")
    path.chmod(0o755)
    return path


def test_a_name_with_a_slash_is_a_path_from_the_folder_of_the_case(built: Path) -> None:
    folder = built.parents[1]
    assert program("target/solid", folder) == str(built)
    assert program("target/none", folder) is None
    built.chmod(0o644)
    assert program("target/solid", folder) is None


def test_other_names_are_looked_for_on_the_path(
    built: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert program("solid", built.parent) is None
    monkeypatch.setenv("PATH", str(built.parent))
    assert program("solid", Path("/")) == str(built)


def test_only_the_program_of_the_words_becomes_a_full_path(
    built: Path, make: Callable[..., Case]
) -> None:
    case = make(continuum__command=["target/solid", "--threads", "2"])
    found = with_program(case, built.parents[1])
    assert found.continuum.command == (str(built), "--threads", "2")
    assert with_program(make(), built.parents[1]) == make()

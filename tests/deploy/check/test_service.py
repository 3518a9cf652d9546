"""The start of the process that makes the checks."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from gimpmd_deploy.check.cases import Checkup
from gimpmd_deploy.check.service import check_service, command_of
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.wire.conformance import Checked


def results(words: list[str], out: Path, **more: float) -> list[Checked]:
    options = {"body": "strip", "case": None, "free_case": None, "groups": ["silence"]}
    checkup = Checkup("continuum")
    found = check_service(checkup, words, out, **options, **{"deadline": 1.0, **more})
    return list(found)


def test_a_command_that_does_not_exist(tmp_path: Path) -> None:
    with pytest.raises(BackendError, match="/no/such/program cannot be started: No such file"):
        results(["/no/such/program"], tmp_path)


def test_a_program_that_is_no_service_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its name is found in the current folder, although it starts in its run folder."""
    (tmp_path / "program.py").write_text("raise SystemExit('what shall I do?')")
    monkeypatch.chdir(tmp_path)
    (result,) = results([sys.executable, "program.py"], tmp_path / "out")
    assert result.passed is False
    assert "exit code 1" in result.came
    assert "what shall I do?" in result.came


def test_the_services_of_gimpmd_have_commands() -> None:
    own = [sys.executable, "-m", "gimpmd_gimp.service"]
    assert command_of("continuum", [], 1) == own
    assert command_of("continuum", [], 2)[1:] == ["-n", "2", *own]
    assert command_of("md", [], 1)[-1] == "serve"
    assert command_of("md", ["mine"], 1) == ["mine"]
    assert command_of("md", ["mine"], 3)[1:] == ["-n", "3", "mine"]

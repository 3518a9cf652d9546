"""The command ``gimpmd check service``: options, lines and exit codes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest
from typer.testing import CliRunner

from gimpmd_deploy.check.cases import Checkup
from gimpmd_deploy.cli import check
from gimpmd_deploy.cli.app import app
from gimpmd_schemas.wire.conformance import GROUPS, Checked

PASSED = Checked(group="course", what="keeps its mass", passed=True, came="1e-16 off")
FAILED = Checked(group="course", what="ends", passed=False, expected="code 0", came="code 1")
LEFT_OUT = Checked(group="rotation", what="rotates", passed=None, came="there is no case")


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What is asked for; the key ``results`` is what comes."""
    seen: dict[str, Any] = {"results": [PASSED, LEFT_OUT]}

    def results_of(checkup: Any, words: list[str], out: Path, **more: Any) -> list[Checked]:
        seen.update(checkup=checkup, words=words, out=out, **more)
        return seen["results"]

    monkeypatch.setattr(check, "results_of", results_of)
    return seen


def invoke(*words: str) -> Any:
    return CliRunner().invoke(app, ["check", "service", *words])


def test_all_groups_and_the_command_after_the_dashes(asked: dict[str, Any]) -> None:
    done = invoke("--side", "continuum", "--", "my-service", "--fast")
    assert done.exit_code == 0
    assert asked["checkup"] == Checkup("continuum")
    assert (asked["words"], asked["body"]) == (["my-service", "--fast"], "strip")
    assert tuple(asked["groups"]) == GROUPS
    assert done.stdout.splitlines() == [
        "passed    course: keeps its mass (1e-16 off)",
        "not made  rotation: rotates (there is no case)",
    ]


def test_a_failure_has_exit_code_3(asked: dict[str, Any], tmp_path: Path) -> None:
    asked["results"] = [PASSED, FAILED]
    done = invoke("--side", "md", "--out", str(tmp_path))
    assert done.exit_code == 3
    assert (
        "FAILED    course: ends\n          expected code 0\n          came code 1\n" in done.stdout
    )
    assert "failed 1 of 2 checks" in done.stderr
    assert f"logs are in {tmp_path}" in done.stderr.replace("\n", "")


def test_lines_of_json(asked: dict[str, Any]) -> None:
    asked["results"] = [PASSED, FAILED]
    done = invoke("--side", "md", "--json")
    lines = done.stdout.splitlines()
    assert [msgspec.json.decode(line, type=Checked) for line in lines] == [PASSED, FAILED]


def test_groups_are_made_in_their_order(asked: dict[str, Any]) -> None:
    invoke("--side", "md", "--groups", "rotation, course")
    assert asked["groups"] == ["course", "rotation"]


def test_ranks_and_a_body(asked: dict[str, Any]) -> None:
    words = ["--backend", "gimp", "--ranks", "2", "--peers", "3", "--body", "levels"]
    invoke("--side", "continuum", *words)
    assert asked["checkup"] == Checkup("continuum", "gimp", ranks=2, peers=3)
    assert asked["body"] == "levels"


def test_a_body_that_does_not_exist(asked: dict[str, Any]) -> None:
    done = invoke("--side", "md", "--body", "sphere")
    assert done.exit_code == 2
    assert "--body = 'sphere': is no body of the checks" in done.stderr


def test_a_group_that_does_not_exist(asked: dict[str, Any]) -> None:
    done = invoke("--side", "md", "--groups", "course,spin")
    assert done.exit_code == 2
    assert "--groups = 'spin': is no group of checks" in done.stderr


def test_a_folder_that_is_not_empty(asked: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "precious").touch()
    done = invoke("--side", "md", "--out", str(tmp_path))
    assert done.exit_code == 2
    assert "is not empty" in done.stderr

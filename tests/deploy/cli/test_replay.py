"""The command ``gimpmd replay``: options, what it prints, and exit codes."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
from typer.testing import CliRunner

from gimpmd_deploy.cli import replay
from gimpmd_deploy.cli.app import app
from gimpmd_deploy.launch.replay import Wanted
from gimpmd_deploy.launch.supervise import Outcome
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.errors import PeerLostError
from gimpmd_schemas.wire.replay import Compared, Difference
from tests.cases import CASE

FIRST = Difference(step=7, rank="md/1", field="velocity", largest=2.5e-13, nodes=1)
LARGEST = Difference(step=9, rank="md/0", field="velocity", largest=0.125, nodes=3)
SAME = Compared(payloads=20, differing=0, first=None, largest={})
OTHER = Compared(payloads=20, differing=2, first=FIRST, largest={"velocity": LARGEST})
CLOSE = Compared(payloads=20, differing=0, first=None, largest={"velocity": FIRST})
NOTHING = Compared(payloads=0, differing=0, first=None, largest={})


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> dict[str, Any]:
    """What is asked for; ``found``, ``stopped`` and ``error`` are what comes."""
    seen: dict[str, Any] = {"found": SAME, "stopped": False, "error": None, "command": ()}
    plan = make_plan(msgspec.convert(CASE, Case))

    def make_ready(run: Path, folder: Path, wanted: Wanted, force: bool) -> SimpleNamespace:
        seen.update(run=run, folder=folder, wanted=wanted, force=force)
        return SimpleNamespace(plan=plan, folder=folder, services=None, lock=None,
                               notes=("a note",), command=seen["command"])  # fmt: skip

    def start(*words: object) -> Outcome:
        assert words[-2:] == (False, math.inf)  # neither restarts nor a deadline
        if seen["error"]:
            raise seen["error"]
        return Outcome(plan.steps, 1.0, seen["stopped"])

    monkeypatch.setattr(replay, "make_ready", make_ready)
    monkeypatch.setattr(replay, "start", start)
    monkeypatch.setattr(replay, "load_result", lambda folder: seen["found"])
    return seen


def invoke(*words: str) -> Any:
    return CliRunner().invoke(app, ["replay", *words])


def test_the_same_bits_have_exit_code_0(asked: dict[str, Any]) -> None:
    done = invoke("runs/wave", "--side", "continuum")
    assert done.exit_code == 0, done.output
    assert asked["folder"] == Path("runs/wave-replay-continuum")
    assert asked["wanted"] == Wanted("continuum")
    assert done.stdout.splitlines() == [
        "warning: a note",
        "block: 10 steps, continuum is played back",
        "20 payloads of md: same bits as in the recording",
        "results in runs/wave-replay-continuum",
    ]


def test_all_options_reach_the_replay(asked: dict[str, Any]) -> None:
    words = ["--out", "x", "--force", "--steps", "5", "--tolerance", "1e-9", "--go-on"]
    assert invoke("r", "--side", "md", *words, "--", "perf", "--quiet", "solid").exit_code == 0
    assert (asked["folder"], asked["force"]) == (Path("x"), True)
    command = ["perf", "--quiet", "solid"]
    assert asked["wanted"] == Wanted("md", 5, 1e-9, True, False, command)


def test_a_difference_has_exit_code_3_and_is_named(asked: dict[str, Any]) -> None:
    asked.update(found=OTHER, stopped=True)
    done = invoke("r", "--side", "continuum")
    assert done.exit_code == 3
    assert "20 payloads of md: 2 differ by more than is accepted" in done.stdout
    first = "first difference: step 7, md/1, velocity at 1 node: up to 2.5e-13 sigma/tau"
    assert first in done.stdout
    assert "largest difference: step 9, md/0, velocity at 3 nodes: up to 0.125" in done.stdout
    assert "md does not send what it has sent in r" in done.stderr


def test_a_difference_within_the_tolerance_is_told(asked: dict[str, Any]) -> None:
    asked["found"] = CLOSE
    done = invoke("r", "--side", "continuum")
    assert done.exit_code == 0
    assert "0 differ by more than is accepted" in done.stdout
    assert "largest difference: step 7" in done.stdout


def test_a_replay_that_was_stopped_has_exit_code_5(asked: dict[str, Any]) -> None:
    asked["stopped"] = True
    assert invoke("r", "--side", "md").exit_code == 5


def test_without_payloads_nothing_has_been_shown(asked: dict[str, Any]) -> None:
    asked["found"] = NOTHING
    done = invoke("r", "--side", "md")
    assert done.exit_code == 3
    assert "continuum has sent nothing that md takes" in done.stderr


def test_what_was_compared_before_a_failure_is_told(asked: dict[str, Any]) -> None:
    asked["error"] = PeerLostError("md/0 was lost at step 9")
    done = invoke("r", "--side", "continuum")
    assert done.exit_code == 3
    assert "20 payloads of md: same bits" in done.stdout
    assert "md/0 was lost at step 9" in done.stderr


def test_the_command_by_hand_is_printed(asked: dict[str, Any]) -> None:
    asked["command"] = ("cd /x", "export A=1", "solid --run y")
    done = invoke("r", "--side", "md", "--by-hand")
    assert (
        "start continuum in another terminal:\n  cd /x\n  export A=1\n  solid --run y"
        in done.stdout
    )


def test_a_run_that_was_not_recorded_has_exit_code_2(tmp_path: Path) -> None:
    done = invoke(str(tmp_path), "--side", "md")
    assert done.exit_code == 2
    assert "there is no run in this folder" in done.stderr

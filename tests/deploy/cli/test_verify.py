"""``gimpmd verify interface``: options, and what it prints of a verdict.

The strips themselves are the business of ``tests/deploy/verify``.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from gimpmd_deploy.verify import interface
from gimpmd_deploy.verify.strips import Wave
from gimpmd_deploy.verify.tasks import QUICK, WAVELENGTHS, Task
from gimpmd_deploy.verify.verdict import Verdict, judge
from gimpmd_schemas.errors import BackendError
from tests.deploy.verify.crystal import HEXAGONAL, IN_SPACE, ground


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """Calls of a stand-in that runs no strips and judges shares that are made up."""
    calls: list[dict[str, Any]] = []

    def verify(case: Path, folder: Path, wavelengths: Any, **options: Any) -> Verdict:
        calls.append({"case": case, "folder": folder, "wavelengths": list(wavelengths)} | options)
        folder.mkdir(parents=True, exist_ok=True)
        wave = Wave(8.0, "P")
        shares = {
            Task(wave, "into"): (0.02, 0.99),
            Task(wave, "out"): (0.01, 0.98),
            Task(wave, "into", "continuum"): (0.02, 0.98),
        }
        return judge(ground(HEXAGONAL), shares)

    monkeypatch.setattr(interface, "verify_interface", verify)
    return calls


def test_defaults(bench, asked) -> None:
    path = bench.write()
    result = bench.gimpmd("verify", "interface", path)
    assert result.exit_code == 0, result.output
    (call,) = asked
    assert call["case"] == path
    assert call["folder"] == Path("runs/block-interface")
    assert call["wavelengths"] == list(WAVELENGTHS[2])
    assert (call["quick"], call["force"], call["axis"], call["jobs"]) == (False, False, None, None)
    assert "shortest wavelength that crosses faithfully: 8 h" in result.stdout
    assert "results in runs/block-interface" in result.stdout
    assert Path("runs/block-interface/interface.png").stat().st_size > 1000


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("--quick",), {"quick": True, "wavelengths": list(QUICK[2])}),
        (("--wavelengths", "6, 8.5"), {"wavelengths": [6.0, 8.5]}),
        (("--quick", "--wavelengths", "9"), {"quick": True, "wavelengths": [9.0]}),
        (("--axis", "x"), {"axis": 0}),
        (("--axis", "y"), {"axis": 1}),
        (("--axis", "z"), {"axis": 2}),
        (("--jobs", "3", "--force"), {"jobs": 3, "force": True}),
        (("--out", "there"), {"folder": Path("there")}),
    ],
)
def test_options_reach_the_verification(bench, asked, options, expected, monkeypatch) -> None:
    monkeypatch.setattr("gimpmd_deploy.figures.crossing.draw_crossing", lambda *_: None)
    result = bench.gimpmd("verify", "interface", bench.write(), *options)
    assert result.exit_code == 0, result.output
    assert {key: asked[0][key] for key in expected} == expected


def test_fewer_waves_in_space(bench, asked) -> None:
    result = bench.gimpmd("verify", "interface", bench.write(IN_SPACE))
    assert result.exit_code == 0, result.output
    assert asked[0]["wavelengths"] == list(WAVELENGTHS[3])


def test_json_is_the_verdict_and_nothing_else(bench, asked) -> None:
    result = bench.gimpmd("verify", "interface", bench.write(), "--json")
    assert result.exit_code == 0, result.output
    verdict = json.loads(result.stdout)
    assert verdict["shortest"] == 8.0
    assert [row["transmitted"] for row in verdict["rows"]] == [0.99, 0.98]
    assert asked[0]["console"].stderr


def test_without_matplotlib_the_verdict_stands(bench, asked, monkeypatch) -> None:
    def draw(*_: object) -> None:
        raise BackendError("figures need matplotlib")

    monkeypatch.setattr("gimpmd_deploy.figures.crossing.draw_crossing", draw)
    result = bench.gimpmd("verify", "interface", bench.write())
    assert result.exit_code == 0, result.output
    assert "no figure: figures need matplotlib" in result.stderr
    assert "crosses faithfully: 8 h" in result.stdout


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--wavelengths", ""), "--wavelengths = '': is not a list of numbers"),
        (("--wavelengths", "eight"), "write for example 6,8,12"),
        (("--wavelengths", "8,,12"), "--wavelengths = '8,,12': is not a list of numbers"),
        (("--axis", "w"), "--axis"),
        (("--jobs", "0"), "--jobs"),
    ],
)
def test_bad_options(bench, asked, options, words) -> None:
    result = bench.gimpmd("verify", "interface", bench.write(), *options)
    assert result.exit_code == 2
    assert words in result.stderr
    assert not asked
    assert not bench.runs.exists()

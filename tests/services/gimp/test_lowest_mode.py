"""The question for the lowest mode of a case."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest
from mpi4py import MPI

from gimpmd_gimp import lowest_mode
from gimpmd_md.stiffness import measure
from gimpmd_schemas.case.load import dump_case
from gimpmd_schemas.wire.answers import LowestMode
from tests.sites_case import measured_case


def test_the_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    case = measured_case(tmp_path)
    monkeypatch.chdir(tmp_path)
    dump_case(case, Path("case.yaml"))
    measure(case, MPI.COMM_SELF, tmp_path, Path("s.npz"))
    monkeypatch.setattr("sys.argv", ["lowest_mode", "--case", "case.yaml", "--stiffness", "s.npz"])
    assert lowest_mode.main() == 0
    answer = msgspec.json.decode(capsys.readouterr().out, type=LowestMode)
    assert answer.freedoms == 664
    assert answer.stiffness == pytest.approx(2.2e-3, rel=0.05)


def test_a_case_that_cannot_be_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["lowest_mode", "--case", str(tmp_path / "none.yaml"), "--stiffness", "s.npz"]
    monkeypatch.setattr("sys.argv", words)
    assert lowest_mode.main() == 2
    assert "none.yaml" in capsys.readouterr().err

"""The question how large the correction of a case is."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from gimpmd_gimp import correction_size
from gimpmd_gimp.coupling.sites.layout import lay_out
from gimpmd_gimp.coupling.sites.memory import size_of_correction
from gimpmd_schemas.case.load import dump_case
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.wire.answers import CorrectionSize
from tests.sites_case import measured_case


def test_the_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    case = measured_case(tmp_path)
    dump_case(case, tmp_path / "case.yaml")
    monkeypatch.setattr("sys.argv", ["correction_size", "--case", str(tmp_path / "case.yaml")])
    assert correction_size.main() == 0
    answer = msgspec.json.decode(capsys.readouterr().out, type=CorrectionSize)
    assert answer == size_of_correction(lay_out(make_plan(case)))
    assert 1e6 < answer.memory < 2e6


def test_a_case_that_cannot_be_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["correction_size", "--case", str(tmp_path / "none.yaml")])
    assert correction_size.main() == 2
    assert "none.yaml" in capsys.readouterr().err

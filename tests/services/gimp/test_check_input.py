"""The question whether a code can use the files of a case."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from gimpmd_gimp import check_input
from tests.cases import CASE, CONTINUUM_ONLY, changed


@pytest.mark.parametrize(("backend", "code"), [("fem", 2), ("gimp", 0)])
def test_a_code_that_reads_files_is_asked(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    backend: str,
    code: int,
) -> None:
    chosen = {"continuum.backend": backend, "continuum.mesh": "m.vtu"}
    (tmp_path / "case.yaml").write_text(yaml.safe_dump(changed(CASE, CONTINUUM_ONLY | chosen)))
    (tmp_path / "m.vtu").write_text("no mesh")
    monkeypatch.setattr("sys.argv", ["check_input", "--case", str(tmp_path / "case.yaml")])
    assert check_input.main() == code
    said = capsys.readouterr().err
    assert said.startswith("continuum.mesh = 'm.vtu': meshio cannot read it" if code else "")
    assert bool(said) == bool(code)

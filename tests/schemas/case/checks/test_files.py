"""Files that LAMMPS reads."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from gimpmd_schemas.case.checks.check import check_case
from gimpmd_schemas.case.form import Case
from tests.schemas.case.checks.cases import MEASURED

Make = Callable[..., Case]


def test_files_beside_the_case(make: Make, tmp_path: Path) -> None:
    case = make(md__after="after.in", md__files=["table.txt"], continuum__material=MEASURED)
    missing = check_case(case, tmp_path)
    keys = {"md.input", "md.after", "md.files[0]", "continuum.material.cell"}
    assert {p.key for p in missing} == keys
    assert all(str(tmp_path) in p.hint for p in missing)
    for name in ("md.in", "after.in", "table.txt", "cell.in"):
        (tmp_path / name).write_text("")
    assert check_case(case, tmp_path) == []
    (tmp_path / "md.in").unlink()
    (tmp_path / "md.in").mkdir()
    assert [p.key for p in check_case(case, tmp_path)] == ["md.input"]

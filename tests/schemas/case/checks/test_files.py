"""Files that the services read, and the program of a continuum service in any language."""

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


def test_a_mesh_lies_beside_the_case_and_is_for_finite_elements(make: Make, tmp_path: Path) -> None:
    (tmp_path / "md.in").write_text("")
    meshed = make(continuum__mesh="body.msh", continuum__backend="fem")
    assert [p.key for p in check_case(meshed, tmp_path)] == ["continuum.mesh"]
    (tmp_path / "body.msh").write_text("")
    assert check_case(meshed, tmp_path) == []
    (refused,) = check_case(make(continuum__mesh="body.msh"), tmp_path)
    assert (refused.key, refused.value) == ("continuum.mesh", "body.msh")
    assert "write continuum.backend: fem" in refused.hint


def test_the_program_of_a_continuum_must_be_there_and_replaces_a_backend(
    make: Make, tmp_path: Path
) -> None:
    (tmp_path / "md.in").write_text("")
    (missing,) = check_case(make(continuum__command=["./solid"]), tmp_path)
    assert missing.key == "continuum.command"
    assert "build it first" in missing.hint
    (tmp_path / "solid").write_text("")
    (tmp_path / "solid").chmod(0o755)
    assert check_case(make(continuum__command=["./solid"]), tmp_path) == []
    both = make(continuum__command=["./solid"], continuum__backend="fem")
    assert [p.key for p in check_case(both, tmp_path)] == ["continuum.backend"]

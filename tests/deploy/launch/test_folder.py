"""Where a run may go, and what lies in its folder before it starts."""

import os
from pathlib import Path

import msgspec
import pytest

from gimpmd_deploy.launch.folder import WRITTEN, check_folder, make_folder
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import load_case
from gimpmd_schemas.case.plan import load_plan, make_plan
from tests.cases import ATOMS, CASE


@pytest.mark.usefixtures("no_services")
def test_output_below_a_file(bench):
    path = bench.write()
    (bench.folder / "plain").write_text("")
    result = bench.gimpmd("run", path, "--out", "plain/run")
    assert result.exit_code == 2
    assert "plain is not a folder" in result.stderr
    assert "--out" in result.stderr


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_output_without_permission(bench):
    path = bench.write()
    (bench.folder / "locked").mkdir(mode=0o500)
    result = bench.gimpmd("run", path, "--out", "locked/run")
    assert result.exit_code == 2
    assert "no permission" in result.stderr


@pytest.mark.usefixtures("no_services")
def test_folder_in_use_is_left_alone(bench):
    path = bench.write()
    precious = bench.runs / "block" / "run.h5"
    precious.parent.mkdir(parents=True)
    precious.write_text("results of last week")
    result = bench.gimpmd("run", path)
    assert result.exit_code == 2
    assert "not empty" in result.stderr
    assert "--force" in result.stderr
    assert precious.read_text() == "results of last week"


@pytest.mark.usefixtures("no_services")
def test_a_run_never_overwrites_its_own_case(bench):
    path = bench.write()
    before = path.read_text()
    result = bench.gimpmd("run", path, "--out", path.parent, "--force")
    assert result.exit_code == 2
    assert "the folder of the case itself" in result.stderr
    assert path.read_text() == before


def test_a_new_folder_replaces_the_run_and_nothing_else(tmp_path: Path) -> None:
    case = msgspec.convert(CASE, Case)
    folder = tmp_path / "run"
    (folder / "fields").mkdir(parents=True)
    (tmp_path / "atoms.in").write_text(ATOMS)
    for name in ("notes.txt", "run.h5", "fields/points.vtkhdf"):
        (folder / name).write_text("from before")
    check_folder(folder, tmp_path, force=True)
    make_folder(case, make_plan(case), tmp_path, folder)
    assert (folder / "notes.txt").read_text() == "from before"
    assert not (folder / "run.h5").exists()
    assert not list((folder / "fields").iterdir())
    assert (folder / "input" / "atoms.in").read_text() == ATOMS
    assert load_case(folder / "case.yaml") == case
    assert load_plan(folder / "plan.yaml") == make_plan(case)
    assert {path.name for path in folder.iterdir()} <= {*WRITTEN, "notes.txt"}

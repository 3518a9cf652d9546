"""Where a run may go, and what lies in its folder before it starts."""

import errno
import os
from pathlib import Path

import msgspec
import pytest

from gimpmd_deploy.launch import folder as folder_module
from gimpmd_deploy.launch.folder import (
    WRITTEN,
    check_folder,
    make_folder,
    storage_trouble,
)
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import load_case
from gimpmd_schemas.case.plan import load_plan, make_plan
from gimpmd_schemas.errors import InputError, StorageError
from gimpmd_schemas.run_lock import MARK, take_lock
from tests.cases import ATOMS, CASE, CONTINUUM_ONLY


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
    take_lock(precious.parent).close()
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
    take_lock(folder).close()
    check_folder(folder, tmp_path, force=True)
    make_folder(case, make_plan(case), tmp_path, folder, force=True).close()
    assert (folder / "notes.txt").read_text() == "from before"
    assert not (folder / "run.h5").exists()
    assert not list((folder / "fields").iterdir())
    assert (folder / "input" / "atoms.in").read_text() == ATOMS
    assert load_case(folder / "case.yaml") == case
    assert load_plan(folder / "plan.yaml") == make_plan(case)
    assert {path.name for path in folder.iterdir()} <= {*WRITTEN, MARK, "notes.txt"}


@pytest.mark.usefixtures("no_services")
def test_force_leaves_a_folder_alone_that_holds_no_run(bench):
    path = bench.write()
    own = bench.folder / "own"
    for name in ("case.yaml", "input/data", "logs/of-mine", "figures/thesis.png", "fields/wheat"):
        (own / name).parent.mkdir(parents=True, exist_ok=True)
        (own / name).write_text("mine")
    before = sorted(own.rglob("*"))
    result = bench.gimpmd("run", path, "--out", own, "--force")
    assert result.exit_code == 2
    assert "it holds no run" in result.stderr
    assert MARK in result.stderr
    assert sorted(own.rglob("*")) == before
    assert all(file.read_text() == "mine" for file in before if file.is_file())


@pytest.mark.usefixtures("no_services")
@pytest.mark.parametrize("command", ["run", "prepare", "slurm"])
def test_a_run_that_goes_on_is_left_alone(bench, command):
    path = bench.write(CONTINUUM_ONLY)
    out = bench.folder / "out"
    assert bench.gimpmd("prepare", path, "--out", out).exit_code == 0
    (out / "run.h5").write_text("results so far")
    with take_lock(out):
        result = bench.gimpmd(command, path, "--out", out, "--force")
    assert result.exit_code == 2
    assert f"a run is going on in this folder (process {os.getpid()} on" in result.stderr
    assert (out / "run.h5").read_text() == "results so far"
    assert bench.gimpmd("prepare", path, "--out", out, "--force").exit_code == 0
    assert not (out / "run.h5").exists()


def test_of_two_starts_at_once_one_is_refused(tmp_path: Path) -> None:
    """Both have found the folder empty before LAMMPS was asked."""
    case = msgspec.convert(CASE, Case)
    (tmp_path / "atoms.in").write_text(ATOMS)
    words = (case, make_plan(case), tmp_path, tmp_path / "run")
    for _ in range(2):
        check_folder(tmp_path / "run", tmp_path, force=False)
    with make_folder(*words, force=False), pytest.raises(InputError, match="a run is going on"):
        make_folder(*words, force=True)
    with pytest.raises(InputError, match="the folder is not empty"):
        make_folder(*words, force=False)


def test_a_folder_that_cannot_be_filled_is_not_left_behind(tmp_path: Path, monkeypatch) -> None:
    def full_disk(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    case = msgspec.convert(CASE, Case)
    (tmp_path / "atoms.in").write_text(ATOMS)
    words = (case, make_plan(case), tmp_path, tmp_path / "run")
    monkeypatch.setattr(folder_module, "write_plan", full_disk)
    with pytest.raises(StorageError, match="run cannot be written: No space left on device"):
        make_folder(*words, force=False)
    assert not (tmp_path / "run").exists()


def test_what_keeps_a_folder_from_being_written(tmp_path: Path, monkeypatch) -> None:
    assert storage_trouble(tmp_path, "md/0 was lost") == ""
    full = os.strerror(errno.ENOSPC)
    assert storage_trouble(tmp_path, f"md/0: ERROR: writing dump: {full} (dump.cpp:543)") == full
    assert storage_trouble(tmp_path / "gone", "md/0 was lost") == "it was deleted"

    def full_disk(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, full)

    monkeypatch.setattr(folder_module.tempfile, "TemporaryFile", full_disk)
    assert storage_trouble(tmp_path, "gimp was killed by SIGSEGV") == full

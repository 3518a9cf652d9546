"""What is found before a run has a folder, and where its errors say that results are."""

from pathlib import Path

import msgspec
import pytest

from gimpmd_deploy.launch import run as module
from gimpmd_deploy.launch.reading import read_case
from gimpmd_deploy.launch.run import ask, default_folder, make_ready, start
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import load_plan
from gimpmd_schemas.errors import BackendError, PeerLostError
from tests.cases import CASE, CONTINUUM_ONLY


def test_default_folder():
    case = msgspec.convert(CASE, Case)
    assert default_folder(case) == Path("runs/block")
    assert default_folder(msgspec.structs.replace(case, only="md")) == Path("runs/block-md")


def test_a_ready_run_has_its_plan_in_its_folder(bench):
    path = bench.write(CONTINUUM_ONLY)
    ready = make_ready(read_case(path), path, bench.runs, force=False)
    assert ready.probe is None
    assert load_plan(bench.runs / "plan.yaml") == ready.plan
    assert ready.plan.only == "continuum"


def test_what_lammps_measured_is_in_the_plan(bench):
    path = bench.write()
    case, probe = ask(read_case(path), path)
    assert probe.cutoff == case.atoms.cutoff == 2.5


def test_a_missing_mpiexec_shows_before_the_folder_is_made(bench, monkeypatch):
    def missing(*_: object) -> None:
        raise BackendError("no mpiexec")

    monkeypatch.setattr(module, "services_of", missing)
    path = bench.write()
    with pytest.raises(BackendError, match="no mpiexec"):
        make_ready(read_case(path), path, bench.runs, force=False)
    assert not bench.runs.exists()


def test_an_error_says_where_the_results_are(bench, monkeypatch):
    def lost(*_: object) -> None:
        raise PeerLostError("md/0 was lost")

    monkeypatch.setattr(module, "supervise", lost)
    path = bench.write(CONTINUUM_ONLY)
    ready = make_ready(read_case(path), path, bench.runs, force=False)
    with pytest.raises(
        PeerLostError, match=rf"md/0 was lost\nthe results so far are in {bench.runs}"
    ):
        start(ready, None)

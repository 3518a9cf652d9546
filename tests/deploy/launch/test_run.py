"""What is found before a run has a folder, and where its errors say that results are."""

import errno
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import h5py
import msgspec
import pytest

from gimpmd_deploy.launch import run as module
from gimpmd_deploy.launch.processes import Service
from gimpmd_deploy.launch.reading import read_case
from gimpmd_deploy.launch.run import default_folder, make_ready, start
from gimpmd_deploy.launch.services import RunServices
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import load_case
from gimpmd_schemas.case.plan import load_plan
from gimpmd_schemas.checkpoint.manifest import Manifest
from gimpmd_schemas.errors import BackendError, PeerLostError, StorageError
from gimpmd_schemas.wire.answers import Probe
from tests.cases import ATOMS, CASE, CONTINUUM_ONLY, REMOVE


def test_default_folder():
    case = msgspec.convert(CASE, Case)
    assert default_folder(case) == Path("runs/block")
    assert default_folder(msgspec.structs.replace(case, only="md")) == Path("runs/block-md")


def test_a_ready_run_has_its_plan_in_its_folder(bench):
    path = bench.write(CONTINUUM_ONLY)
    ready = make_ready(read_case(path), path, bench.runs, force=False)
    assert ready.probe == Probe()
    assert load_plan(bench.runs / "plan.yaml") == ready.plan
    assert ready.plan.only == "continuum"


def test_what_lammps_measured_is_in_the_plan(bench):
    path = bench.write()
    ready = make_ready(read_case(path), path, bench.runs, force=False)
    assert ready.plan.atoms.cutoff == ready.probe.cutoff == 2.5
    assert load_case(bench.runs / "case.yaml") == read_case(path)  # as the user wrote it


def test_a_missing_mpiexec_shows_before_the_folder_is_made(bench, monkeypatch):
    def missing(*_: object) -> None:
        raise BackendError("no mpiexec")

    monkeypatch.setattr(module, "services_of", missing)
    path = bench.write()
    with pytest.raises(BackendError, match="no mpiexec"):
        make_ready(read_case(path), path, bench.runs, force=False)
    assert not bench.runs.exists()


def test_an_error_says_where_the_results_are(bench, monkeypatch):
    def lost(*_: object, **__: object) -> None:
        raise PeerLostError("md/0 was lost")

    monkeypatch.setattr(module, "supervise", lost)
    path = bench.write(CONTINUUM_ONLY)
    ready = make_ready(read_case(path), path, bench.runs, force=False)
    with pytest.raises(
        PeerLostError, match=rf"md/0 was lost\nthe results so far are in {bench.runs}"
    ):
        start(ready.folder, ready.services, ready.lock, None)


REGIONS = {"md.region": REMOVE, "md.regions": [[[0, 40], [0, 80]], [[72, 104], [20, 60]]]}


@pytest.mark.usefixtures("no_services")
@pytest.mark.parametrize(
    ("script", "changes", "words"),
    [
        ("units lj\ndimensoin 2\n", {}, ("ERROR", "dimensoin")),
        ("", {}, ("atoms.in",)),
        (None, {"time.md_timestep": 0.05, "time.md_steps": 1}, ("time.md_timestep", "at most")),
        (None, {"md.cutoff": 2.0}, ("md.cutoff", "2.5", "leave the key out")),
        (None, {"coupling.zones.outer": 2.0}, ("outer", "2.5", "at least")),
        (
            None,
            {"coupling": {"scheme": "force", "zones": {"outer": 2.0}}},
            ("coupling.zones.outer", "2.5", "at least"),
        ),
        (
            ATOMS + "region hole sphere 57 40 0 1 units box\ndelete_atoms region hole\n",
            {"coupling.scheme": "force"},
            ("no atom at (56.", "perfect", "set coupling.scheme: velocity"),
        ),
        (
            ATOMS.replace("lj/cut 2.5", "lj/cut 2.2271"),
            {"coupling.scheme": "force"},
            ("cross the cutoff", "set coupling.scheme: velocity"),
        ),
        (
            None,
            {**REGIONS, "coupling.scheme": "force"},
            ("in none of md.regions", "xlo1 xhi1 ylo1 yhi1"),
        ),
        (
            ATOMS.replace(
                "create_atoms 1 region box",
                """\
region one block ${xlo1} ${xhi1} ${ylo1} ${yhi1} -0.5 0.5 units box
region two block ${xlo2} ${xhi2} ${ylo2} ${yhi2} -0.5 0.5 units box
create_atoms 1 region one
lattice hex ${density} origin 0.5 0.25 0
create_atoms 1 region two""",
            ),
            {**REGIONS, "coupling.scheme": "force"},
            ("off the lattice of its neighbours", "set coupling.scheme: velocity"),
        ),
    ],
    ids=[
        "unknown command",
        "empty",
        "long MD step",
        "wrong cutoff",
        "narrow outer zone",
        "narrow ghost zone",
        "vacancy at the interface",
        "neighbours at the cutoff",
        "atoms between the regions",
        "another lattice in the second region",
    ],
)
def test_what_only_lammps_can_refuse(bench, script, changes, words):
    path = bench.write(changes, ATOMS if script is None else script)
    result = bench.gimpmd("run", path)
    assert result.exit_code == 2, result.output
    for word in (str(path), *words):
        assert word in result.stderr, result.stderr
    assert "Traceback" not in result.output
    assert not bench.runs.exists()


RECORD = """
import sys
from pathlib import Path
import numpy as np
from gimpmd_coupler.recorder import Recorder
recorder = Recorder(Path(sys.argv[1]), "", "lj")
recorder.add({"/series/step": np.zeros(1, int), "/series/time": np.zeros(1)})
recorder.drop()
"""


@pytest.fixture
def killed(bench, monkeypatch):
    """A ready run whose coupler dies after the first step; a function that says with what words."""
    path = bench.write(CONTINUUM_ONLY)
    ready = make_ready(read_case(path), path, bench.runs, force=False)
    subprocess.run([sys.executable, "-c", RECORD, str(bench.runs / "run.h5")], check=True)

    def end(words: str) -> None:
        def lost(*_: object, **__: object) -> None:
            raise PeerLostError(words)

        monkeypatch.setattr(module, "supervise", lost)
        start(ready.folder, ready.services, ready.lock, None)

    return end


def test_the_record_says_how_the_coupler_was_lost(bench, killed):
    with pytest.raises(PeerLostError):
        killed("coupler was lost at step 0: it was killed by SIGKILL\nend of its log")
    with h5py.File(bench.runs / "run.h5") as file:
        expected = "failed: coupler was lost at step 0: it was killed by SIGKILL"
        assert file.attrs["outcome"] == expected
        assert list(file["series/step"]) == [0]


def test_a_full_disk_is_the_cause_whoever_dies_of_it(bench, killed, monkeypatch):
    full = os.strerror(errno.ENOSPC)
    monkeypatch.setattr(module, "storage_trouble", lambda *_: full)
    with pytest.raises(StorageError, match=f"cannot write in the run folder .*: {full}") as caught:
        killed("continuum/0 was lost at step 3: its process is gone")
    assert caught.value.exit_code == 3
    assert "continuum/0 was lost at step 3" in str(caught.value)
    with h5py.File(bench.runs / "run.h5") as file:
        assert full in file.attrs["outcome"]


def test_the_services_of_the_run_and_the_deadline_of_the_user_hold_in_each_attempt(
    bench, monkeypatch
):
    path = bench.write(CONTINUUM_ONLY)
    ready = make_ready(read_case(path), path, bench.runs, force=False)
    own = Service("coupler", ["couple"], bench.runs / "couple.log", bench.runs)
    services = RunServices(own, lambda _: (), again=lambda: services)
    seen = []

    def lost_once(coupler: Service, *_: object, **__: object) -> None:
        seen.append(coupler.argv)
        if len(seen) == 1:
            raise PeerLostError("md/0 was lost")

    last = Manifest(step=0, time=0.0, state="", ranks={}, start_energy=None, files={})
    monkeypatch.setattr(module, "supervise", lost_once)
    monkeypatch.setattr(module, "_place_to_go_on", lambda *_: last)
    monkeypatch.setattr(module, "drop_unfinished", lambda *_: None)
    watcher = SimpleNamespace(say=lambda _: None)
    start(bench.runs, services, ready.lock, watcher, deadline=45.0)
    assert seen == [["couple", "--deadline", "45.0"]] * 2

"""Runs that go on from a checkpoint: same bits, other ends, other ranks, and after a death."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import h5py
import pytest

from gimpmd_schemas.checkpoint.manifest import FOLDER, committed, folder_of
from tests.cases import changed, small_case
from tests.conftest import ROOT
from tests.monitors.disasters import WAVE
from tests.running import Running
from tests.system.conftest import Command

EVERY = {"checkpoint": {"steps": 10, "keep": 100}}
"""A checkpoint at every tenth of fifty coupling steps."""

WAYS = [
    pytest.param({}, "", id="force scheme", marks=pytest.mark.long),
    pytest.param(
        {"coupling": {"scheme": "velocity", "zones": {"outer": 3.0}}},
        "",
        id="velocity scheme",
        marks=pytest.mark.long,
    ),
    pytest.param({}, "--only md", id="MD alone", marks=pytest.mark.long),
    pytest.param(
        {
            "boundary.top.value": [0, 12.0],
            "boundary.bottom.value": [0, -12.0],
        },
        "",
        id="findings",
        marks=pytest.mark.long,
    ),
    pytest.param(
        {"grid": {"cell": 4, "levels": [{"boxes": [[[0, 44], [16, 48]]]}]}},
        "--only continuum",
        id="continuum alone",
        marks=pytest.mark.long,
    ),
    pytest.param(
        {
            "coupling.absorber": {"rate": 2.0, "temperature": 1e-4, "seed": 7},
            "md": small_case()["md"] | {"ranks": 1, "patches": "auto"},
        },
        "--ranks-gimp 2",
        id="absorber",
        marks=pytest.mark.long,
    ),
]


def differing(one: Path, other: Path) -> list[str]:
    """Data sets of two files that do not have the same bits, wall times and memory apart."""
    found = []
    with h5py.File(one) as a, h5py.File(other) as b:

        def compare(name: str, item: Any) -> None:
            timed = name.startswith(("timings", "memory"))
            if isinstance(item, h5py.Dataset) and not timed:
                x, y = item[()], b[name][()]
                if x.shape != y.shape or x.tobytes() != y.tobytes():
                    found.append(f"{name} of {one.name}")

        a.visititems(compare)
    return found


def check_same_bits(one: Path, other: Path) -> None:
    """Two runs have the same record, output files and state at their end."""
    last = folder_of(one, committed(one)[0].step)
    names = [path.name for path in last.glob("*.h5")]
    pairs = [(last / n, folder_of(other, int(last.name)) / n) for n in names]
    pairs.append((one / "run.h5", other / "run.h5"))
    fields = "fields/points.vtkhdf"
    if (one / fields).exists():
        pairs.append((one / fields, other / fields))
    assert [text for pair in pairs for text in differing(*pair)] == []
    dump = "atoms/atoms.dump"
    if (one / dump).exists():
        assert (one / dump).read_bytes() == (other / dump).read_bytes()


def resume(command: Command, folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command.arguments("resume", str(folder), "--no-figures", *options),
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )


def cut(folder: Path, target: Path, step: int) -> Path:
    """A copy of a run as if it had been killed after the checkpoint of a step."""
    shutil.copytree(folder, target, symlinks=True)
    for path in (target / FOLDER).iterdir():
        if int(path.name) > step:
            shutil.rmtree(path)
    return target


@pytest.mark.parametrize(("changes", "options"), WAYS)
def test_a_run_goes_on_with_the_same_bits(command, finished, tmp_path, changes, options) -> None:
    whole = finished(EVERY | changes, *options.split()).folder
    rest = cut(whole, tmp_path / "rest", 20)
    done = resume(command, rest)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "goes on at step 20 of 50" in done.stdout
    check_same_bits(whole, rest)
    log = rest / "logs/log.lammps"
    assert not log.exists() or "minimize" not in log.read_text()  # atoms go to their saved places


@pytest.mark.long
def test_random_numbers_of_fixes_have_the_same_bits(command, tmp_path) -> None:
    (command.folder / "after.in").write_text("fix warm gimpmd_free langevin 0.01 0.01 1.0 7\n")
    whole = command.run(changed(small_case(), EVERY | {"md.after": "after.in"})).folder
    rest = cut(whole, tmp_path / "rest", 20)
    done = resume(command, rest)
    assert done.returncode == 0, done.stdout + done.stderr
    check_same_bits(whole, rest)


@pytest.mark.long
def test_a_checkpoint_changes_nothing(command, finished) -> None:
    """Results do not depend on when checkpoints are made, because the state is renewed anyway."""
    whole = finished(EVERY).folder
    case = changed(small_case(), {"checkpoint": {"steps": 10, "keep": 1}})
    other = command.run(case).folder
    assert [one.step for one in committed(other)] == [50]
    assert differing(whole / "run.h5", other / "run.h5") == []


def check_close(found: h5py.File, expected: h5py.File, row: int) -> None:
    """Two records agree up to round-off at a step."""
    for name in ("total/energy", "md/momentum_x", "continuum/kinetic"):
        one, other = (file[f"series/{name}"][row] for file in (found, expected))
        assert one == pytest.approx(other, rel=1e-6, abs=1e-10), name


@pytest.mark.long
def test_a_run_goes_on_on_other_ranks_and_to_a_later_end(command, finished, tmp_path) -> None:
    whole = finished(EVERY).folder
    rest = cut(whole, tmp_path / "rest", 30)
    done = resume(command, rest, "--until", "2.4", "--ranks-md", "1")
    assert done.returncode == 0, done.stdout + done.stderr
    with h5py.File(rest / "run.h5") as a, h5py.File(whole / "run.h5") as b:
        assert a["series/step"][:].tolist() == list(range(61))
        check_close(a, b, 50)


@pytest.mark.long
def test_a_finding_about_the_whole_body_is_the_same_after_a_resume(command, case, tmp_path) -> None:
    """A fix in the script of the atoms, whose work is not measured, feeds them energy."""
    script = command.folder / "crack.in"
    script.write_text(script.read_text() + "fix pump all viscous -1.0\n")
    case |= EVERY | {"coupling": {"scheme": "velocity", "zones": {"outer": 3.0}}}
    case |= {"boundary": {}, "initial": WAVE}
    case["time"]["end"] = 2.4
    whole = command.run(case).folder
    rest = cut(whole, tmp_path / "rest", 40)  # monitors look at step 30, .17, and at 60, .22
    done = resume(command, rest)
    assert done.returncode == 0, done.stdout + done.stderr
    check_same_bits(whole, rest)
    with h5py.File(rest / "run.h5") as file:
        (finding,) = file["findings"][:]
    assert (finding["side"], finding["kind"]) == (b"body", b"total energy")
    assert finding["step"] == 60


@pytest.mark.long
@pytest.mark.parametrize(
    "options", ["--ranks-md 1", "--ranks-gimp 2", "--ranks-md 4 --ranks-gimp 2"]
)
def test_a_finished_run_is_extended_on_other_ranks(command, finished, tmp_path, options) -> None:
    """Against a run that was as long from the start: equal up to round-off."""
    short = finished(EVERY).folder
    longer = finished(EVERY | {"time.end": 2.4, "output.energy_interval": 0.04}).folder
    rest = tmp_path / "rest"
    shutil.copytree(short, rest)
    done = resume(command, rest, "--until", "2.4", *options.split())
    assert done.returncode == 0, done.stdout + done.stderr
    with h5py.File(rest / "run.h5") as a, h5py.File(longer / "run.h5") as b:
        assert a["series/step"][:].tolist() == b["series/step"][:].tolist() == list(range(61))
        check_close(a, b, -1)


def test_a_damaged_checkpoint_is_left_out(command, finished, tmp_path) -> None:
    whole = finished(EVERY).folder
    rest = cut(whole, tmp_path / "rest", 30)
    path = folder_of(rest, 30) / "md.1.h5"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    done = resume(command, rest)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "the checkpoint of step 30 is left out" in done.stdout
    assert "md.1.h5 is damaged" in done.stdout.replace("\n", "")
    assert "goes on at step 20" in done.stdout
    assert (rest / FOLDER / "30.damaged").is_dir()
    check_same_bits(whole, rest)
    # atoms go to their saved places
    assert "minimize" not in (rest / "logs/log.lammps").read_text()


def test_a_finished_run_needs_a_later_end(command, finished) -> None:
    whole = finished(EVERY).folder
    done = resume(command, whole)
    assert done.returncode == 2
    assert "give a later end with --until" in done.stderr
    assert resume(command, command.folder).returncode == 2, "no run"


def test_a_run_that_was_not_finished_is_offered(command, finished, tmp_path) -> None:
    rest = cut(finished(EVERY).folder, command.folder / "run", 20)
    done = command.attempt(small_case())
    assert done.returncode == 2
    assert f"go on with gimpmd resume {rest}" in done.stderr


def test_a_case_with_a_later_end_goes_on_with_its_run(command, finished) -> None:
    shutil.copytree(finished(EVERY).folder, command.folder / "run", symlinks=True)
    case = changed(small_case(), EVERY)
    other = command.attempt(changed(case, {"md.variables.crack_length": 20}), "--until", "2.4")
    assert other.returncode == 2
    assert "md.variables.crack_length = 20" in other.stderr
    assert "start a new run with --force" in other.stderr
    done = command.attempt(case, "--until", "2.4")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "goes on at step 50 of 60" in done.stdout
    with h5py.File(command.folder / "run/run.h5") as file:
        assert file["series/step"][:].tolist() == list(range(61))


def start(command: Command) -> Running:
    """Start the small case with checkpoints."""
    folder = command.folder / "run"
    case = command.write(changed(small_case(), EVERY))
    words = command.arguments("run", str(case), "--out", str(folder), "--no-figures")
    return Running(words, folder, command.folder / "output.txt")


@pytest.mark.parametrize(
    "module",
    [
        "gimpmd_md",
        pytest.param("gimpmd_gimp", marks=pytest.mark.long),
        pytest.param("gimpmd_coupler", marks=pytest.mark.long),
    ],
)
def test_a_run_goes_on_by_itself_when_a_process_is_killed(command, finished, module) -> None:
    whole = finished(EVERY).folder
    run = start(command)
    run.wait_for(lambda: committed(run.folder))
    run.processes(module)[0].kill()
    assert run.process.wait(200) == 0, run.output
    assert re.search(r"going on from the checkpoint at step [1-4]0", run.output)
    check_same_bits(whole, run.folder)


@pytest.mark.long
@pytest.mark.parametrize("program", ["gimpmd-md", "gimpmd-coupler"])
def test_services_of_a_file_go_on_by_themselves(command, finished, program) -> None:
    whole = finished(EVERY).folder
    folder, case = command.folder / "run", command.write(changed(small_case(), EVERY))
    file = str(ROOT / "deploy" / "compose.yaml")
    words = command.arguments("up", str(case), "--file", file, "--out", str(folder))
    run = Running(words, folder, command.folder / "output.txt")
    run.wait_for(lambda: committed(run.folder))
    run.processes(program)[0].kill()
    run.wait_for(lambda: "going on" in run.output and run.processes(program))  # of the file again
    assert run.process.wait(200) == 0, run.output
    check_same_bits(whole, run.folder)


@pytest.mark.long
def test_a_run_that_dies_each_time_is_given_up(command) -> None:
    run = start(command)
    run.wait_for(lambda: committed(run.folder))
    for restarts in range(3):
        run.wait_for(lambda n=restarts: run.output.count("going on") == n)
        run.wait_for(lambda: run.processes("gimpmd_md"))
        run.processes("gimpmd_md")[0].kill()
    assert run.process.wait(60) == 3
    assert re.search(r"the run has died [23] times after step [1-4]0", run.output)
    assert "Traceback" not in run.output

"""How runs end before their time: a killed service, Ctrl-C, bad LAMMPS input."""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import sys
import time

import pytest
import yaml

import gimpmd
from gimpmd_deploy.check.cases import STRIP
from gimpmd_schemas.errors import STOPPED
from tests.cases import changed
from tests.running import Running, survivors

MD = "gimpmd_md.service serve"
"""In the command line of the ranks, but not of the process that looks at the script before."""

LIMIT = 5.0
"""Seconds within which a run ends when a service dies."""


@pytest.fixture
def run(command, case, request):
    """A run that would last long; the parameter is the command."""
    case["time"]["end"] = 1000.0
    out = command.folder / "run"
    words = (*request.param.split(), str(command.write(case)), "--out", str(out))
    run = Running(command.arguments(*words), out, command.folder / "output.txt")
    yield run
    if run.process.poll() is None:
        run.process.kill()


@pytest.mark.parametrize(
    ("run", "module", "index", "name"),
    [
        pytest.param("run", "gimpmd_coupler", 0, "coupler", marks=pytest.mark.long),
        pytest.param("run", "gimpmd_gimp", 0, "continuum/", marks=pytest.mark.long),
        pytest.param("run", MD, 0, "md/", marks=pytest.mark.long),
        ("run --only md", MD, -1, "md/"),
    ],
    indirect=["run"],
)
def test_kill_9_ends_the_run_and_names_the_dead(run, module, index, name):
    run.wait_for_steps()
    family = run.family()
    run.processes(module)[index].kill()
    took = run.wait_for_end(LIMIT)
    assert run.process.returncode == 3, run.output
    assert took < LIMIT, f"{took:.1f} s"
    assert "Traceback" not in run.output
    (error,) = re.findall(r"^error: (.*)$", run.output, re.MULTILINE)
    assert name in error
    for other in {"coupler", "continuum/", "md/"} - {name}:
        assert other not in error
    assert survivors(family) == []
    assert not run.folder_of_the_bus().exists()
    assert run.outcome().startswith("failed: ")
    assert name in run.outcome()
    assert run.recorded_steps() > 0
    print(f"{name}: ended {took:.2f} s after kill -9")


@pytest.mark.parametrize("run", ["run --only continuum"], indirect=True)
def test_a_frozen_coupler_is_named_within_seconds(run):
    run.wait_for_steps()
    family = run.family()
    run.processes("gimpmd_coupler")[0].suspend()
    took = run.wait_for_end(12.0)
    assert run.process.returncode == 3, run.output
    assert took < 12.0, f"{took:.1f} s"
    (error,) = re.findall(r"^error: (.*)$", run.output, re.MULTILINE)
    assert "coupler was lost at step" in error
    assert "its process is stopped" in error
    assert survivors(family) == []
    assert not run.folder_of_the_bus().exists()
    assert run.outcome() == f"failed: {error}"


@pytest.mark.long
@pytest.mark.parametrize("run", ["run"], indirect=True)
@pytest.mark.parametrize("delay", [0.2, 1.0, 2.0])
def test_a_rank_that_dies_while_it_starts_is_named(run, delay):
    run.wait_for(lambda: run.processes(MD))
    time.sleep(delay)
    run.processes(MD)[-1].kill()
    run.wait_for_end(20.0)
    assert run.process.returncode == 3, run.output
    (error,) = re.findall(r"^error: (.*)$", run.output, re.MULTILINE)
    for said in (error, run.outcome()):
        assert "md" in said
        assert "was lost" in said
        assert "continuum" not in said
        assert "gimp " not in said


@pytest.mark.parametrize("run", ["up"], indirect=True)
def test_ctrl_c_stops_cleanly_and_says_how_far_it_came(run):
    run.wait_for_steps()
    family = run.family()
    run.process.send_signal(signal.SIGINT)
    took = run.wait_for_end(LIMIT)
    assert took < LIMIT + 5.0, f"{took:.1f} s"
    assert run.process.returncode == STOPPED, run.output
    assert re.search(r"stopped at step \d+ of 25000, t = ", run.output), run.output
    assert "coupler | " in run.output
    assert run.outcome() == "stopped"
    assert survivors(family) == []


@pytest.mark.long
def test_ctrl_c_stops_ranks_that_wait_for_others_of_their_service(tmp_path):
    """The last of three ranks has no nodes of the interface, so it waits in the middle of a step.

    Before the coupler set such ranks free, they were killed at the end of the launcher's patience.
    """
    long = {"time.end": 1600.0, "output": {"interval": 1600.0}, "coupling": {"scheme": "force"}}
    case = changed(yaml.safe_load(STRIP.read_text()), {"continuum.ranks": 3, **long})
    (tmp_path / "case.yaml").write_text(yaml.safe_dump(case))
    shutil.copy(STRIP.with_name("crystal.in"), tmp_path)
    out = tmp_path / "run"
    words = ["run", str(tmp_path / "case.yaml"), "--out", str(out), "--no-figures"]
    gimpmd = [sys.executable, "-m", "gimpmd_deploy.cli.app"]
    run = Running([*gimpmd, *words], out, tmp_path / "output.txt")
    run.wait_for_steps()
    run.process.send_signal(signal.SIGINT)
    run.wait_for_end(60.0)
    assert run.process.returncode == STOPPED, run.output
    assert "were killed" not in run.output


@pytest.mark.parametrize("run", ["run --only md"], indirect=True)
def test_a_killed_supervisor_leaves_no_orphans(run):
    run.wait_for_steps()
    family = run.family()
    run.process.kill()
    assert survivors(family, patience=10.0) == []
    assert run.outcome() == "stopped"


@pytest.mark.parametrize("run", ["run --only continuum"], indirect=True)
def test_a_supervisor_killed_while_the_coupler_starts_leaves_no_orphans(run):
    run.wait_for(lambda: run.processes("gimpmd_coupler"))
    (coupler,) = run.processes("gimpmd_coupler")
    family = run.family()
    assert coupler in family
    run.process.kill()
    assert survivors(family, patience=60.0) == []


@pytest.mark.parametrize("run", ["run --only continuum"], indirect=True)
def test_a_run_outlives_its_terminal_a_pause_and_others_that_want_its_folder(run, command):
    run.wait_for_steps()
    run.process.send_signal(signal.SIGHUP)  # the terminal is closed
    run.process.send_signal(signal.SIGSTOP)  # Ctrl-Z
    words = [
        "run",
        "--only",
        "continuum",
        str(command.folder / "case.yaml"),
        "--out",
        str(run.folder),
    ]
    for options in ([], ["--force"]):
        other = subprocess.run(
            command.arguments(*words, *options), capture_output=True, text=True, check=False
        )
        assert other.returncode == 2, other.stdout + other.stderr
        assert f"a run is going on in this folder (process {run.process.pid}" in other.stderr
    run.process.send_signal(signal.SIGCONT)
    time.sleep(1.0)
    assert run.process.poll() is None, run.output
    run.process.send_signal(signal.SIGTERM)
    run.wait_for_end(LIMIT)
    assert run.process.returncode == STOPPED, run.output
    assert run.outcome() == "stopped"
    assert run.recorded_steps() > 10


@pytest.mark.long
@pytest.mark.parametrize("run", ["run --only continuum"], indirect=True)
def test_a_deleted_run_folder_ends_the_run(run):
    run.wait_for_steps()
    shutil.rmtree(run.folder)
    run.wait_for_end(20.0)
    assert run.process.returncode == 3, run.output
    (error,) = re.findall(r"^error: (.*)$", run.output, re.MULTILINE)
    assert error == f"cannot write in the run folder {run.folder}: it was deleted"
    assert "Traceback" not in run.output


def test_a_reader_that_leaves_early_does_not_end_the_run(command, case):
    """As in ``gimpmd run CASE | head -1``."""
    words = command.arguments("run", "--only", "continuum", str(command.write(case)))
    with subprocess.Popen(
        [*words, "--out", str(command.folder / "run"), "--no-figures"], stdout=subprocess.PIPE
    ) as process:
        assert process.stdout.readline().startswith(b"small: ")
        process.stdout.close()
        assert process.wait(timeout=200) == 0
    assert gimpmd.open(command.folder / "run").outcome == "completed"


def test_a_defect_at_the_planes_stops_the_run_if_asked(command, case):
    """The halves of the body part at high speed, so bonds between them break near the planes."""
    case["time"]["end"] = 8.0
    case["coupling"] = {"on_defect": "stop"}
    case["initial"] = {
        "velocities": [
            {"box": [[20, 64], [32, 64]], "velocity": [0, 1]},
            {"box": [[20, 64], [0, 32]], "velocity": [0, -1]},
        ]
    }
    done = command.attempt(case)
    assert done.returncode == 4, done.stdout + done.stderr
    defect = r"warning: atoms, t = \S+, near \([^)]*\): a defect of the crystal has reached the"
    assert len(re.findall(defect, " ".join(done.stdout.split()))) == 1
    assert "(coupling.on_defect: stop)" in done.stderr
    run = gimpmd.open(command.folder / "run")
    assert run.outcome == "stopped: a monitor found that the results are not reliable"
    (first,) = [found for found in run.findings if found.kind == "broken bond"]
    assert first.side == "md"
    assert first.time < 2.0
    assert abs(first.place[1] - 32.0) < 4.0
    assert run.energies.time[-1] == pytest.approx(run.findings[0].time + run.plan.step)


def test_what_only_lammps_finds_ends_with_its_own_words(command, case):
    script = (command.folder / "crack.in").read_text()
    (command.folder / "crack.in").write_text(script.replace("lj/cut 2.5", "lj/cutt 2.5"))
    start = time.monotonic()
    done = command.attempt(case, timeout=60)
    assert done.returncode == 2, done.stdout + done.stderr
    assert "Unrecognized pair style 'lj/cutt'" in done.stdout + done.stderr
    assert time.monotonic() - start < 30.0
    assert not (command.folder / "run").exists()


def test_a_script_that_fails_after_gimpmd_made_its_groups_is_found_before_the_run(command, case):
    (command.folder / "after.in").write_text("fix hot gimpmd_free langevinn 1 1 1 1\n")
    case["md"]["after"] = "after.in"
    done = command.attempt(case, timeout=60)
    assert done.returncode == 2, done.stdout + done.stderr
    assert "langevinn" in done.stdout + done.stderr
    assert not (command.folder / "run").exists()


def test_quit_after_gimpmds_groups_ends_the_run_with_the_script_named(command, case):
    (command.folder / "after.in").write_text("group mine id 1\nquit\n")
    case["md"]["after"] = "after.in"
    done = command.attempt(case, "--only", "md")
    assert done.returncode == 2, done.stdout + done.stderr
    assert "after.in: the command quit ended LAMMPS" in done.stderr
    assert "continuum" not in done.stderr
    assert not (command.folder / "run").exists()

"""The continuum service in Rust: the bounds of our own codes, and all parts of the protocol."""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from gimpmd_deploy.results.run import Run
from gimpmd_schemas.checkpoint.manifest import FOLDER, committed, folder_of
from gimpmd_schemas.errors import STOPPED
from tests.cases import CASE, CONTINUUM_ONLY, changed
from tests.foreign.conftest import CRATE, OURS, SAME, STEPS, Write
from tests.physics.interface import packets
from tests.physics.sides import PROGRAM, run_sides
from tests.physics.test_sides import check
from tests.ports import free_port
from tests.running import Running
from tests.small_run import GIMPMD, ByHand
from tests.system.test_resume import differing

pytestmark = [pytest.mark.foreign, pytest.mark.timeout(1800)]

SAVING = {"checkpoint": {"steps": 20, "keep": 100}}


def attempt(case: Path, name: str = "run") -> subprocess.CompletedProcess[str]:
    """Run a case, however it ends."""
    words = [GIMPMD, "run", str(case), "--out", str(case.parent / name), "--no-figures"]
    return subprocess.run(words, capture_output=True, text=True, check=False)


def run(case: Path, name: str = "run") -> Path:
    """Run a case to its end; return the run folder."""
    done = attempt(case, name)
    assert done.returncode == 0, done.stdout + done.stderr
    return case.parent / name


def state(folder: Path, step: int) -> bytes:
    """The state of the continuum at a checkpoint."""
    return (folder_of(folder, step) / "continuum.0.h5").read_bytes()


def started(case: Path) -> Running:
    """Start a run."""
    folder = case.parent / "run"
    words = [GIMPMD, "run", str(case), "--out", str(folder), "--no-figures"]
    return Running(words, folder, case.parent / "log")


def test_its_own_tests_pass() -> None:
    done = subprocess.run(
        ["cargo", "test", "--release", "--quiet"],
        cwd=CRATE,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 passed" not in done.stdout


def test_it_passes_the_check_of_services() -> None:
    words = [GIMPMD, "check", "service", "--side", "continuum", "--", str(PROGRAM)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "rotation: rotates without strain" in done.stdout


@pytest.mark.parametrize("way", packets.WAYS)
def test_a_wave_crosses_with_the_bounds_of_our_own_codes(tmp_path: Path, way: Any) -> None:
    found = run_sides(way, tmp_path / "foreign", "lammps", "foreign")
    check(way, found, tmp_path)
    energy = found.energies.energy
    assert abs(energy[-1] / energy[0] - 1.0) < 0.01  # the bound of the scheme for N > 1
    assert (found.folder / "fields" / f"nodes.{found.plan.steps:010}.vtk").exists()


def test_the_absorber_of_the_atoms_takes_what_it_takes_beside_our_finite_elements(
    write: Write,
) -> None:
    changes = {"coupling__absorber": {}, "checkpoint": None}
    foreign = Run(run(write(**changes), "foreign")).energies
    ours = Run(run(write(**changes, **OURS), "ours")).energies
    taken = foreign.md.dissipated
    assert taken[-1] > 0.0
    np.testing.assert_allclose(taken, ours.md.dissipated, rtol=SAME, atol=SAME * taken[-1])
    work = foreign.continuum.interface_work
    largest = np.abs(work).max()
    np.testing.assert_allclose(work, ours.continuum.interface_work, rtol=0.0, atol=SAME * largest)
    assert foreign.largest_imbalance() < 0.01  # the bound of the scheme for N > 1


def test_a_run_with_broken_connections_and_one_that_goes_on_have_the_same_bits(
    write: Write, tmp_path: Path
) -> None:
    whole = run(write(**SAVING), "whole")
    cutting = [sys.executable, "-m", "tests.foreign.cutting", str(PROGRAM)]
    cut = run(write(**SAVING, continuum__command=cutting), "cut")
    (cuts,) = re.findall(r"cut (\d+) times", (cut / "logs" / "gimp.log").read_text())
    assert int(cuts) >= 3

    rest = tmp_path / "rest"
    shutil.copytree(whole, rest)
    for path in (rest / FOLDER).iterdir():
        if int(path.name) > 20:
            shutil.rmtree(path)
    words = [GIMPMD, "resume", str(rest), "--no-figures"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"goes on at step 20 of {STEPS}" in done.stdout

    assert [one.step for one in committed(whole)] == [60, 40, 20]
    for other in (cut, rest):
        assert differing(whole / "run.h5", other / "run.h5") == []
        assert state(other, STEPS) == state(whole, STEPS)


def test_between_hosts_it_shows_the_keys_of_its_role(write: Write, tmp_path: Path) -> None:
    case = write(checkpoint=None)
    here = Run(run(case, "here")).energies.energy
    listen = ("--listen", f"localhost:{free_port()}")
    with ByHand(case, tmp_path / "by-hand", *listen) as by_hand:
        found = by_hand.finished()
    np.testing.assert_array_equal(found.energies.energy, here)


def test_sigterm_stops_the_run_with_a_checkpoint(write: Write) -> None:
    running = started(write(time__end=8000.0, output__interval=8000.0))
    running.wait_for_steps()
    running.processes(PROGRAM.name)[0].send_signal(signal.SIGTERM)
    assert running.process.wait(60) == STOPPED, running.output
    assert running.outcome() == "stopped"
    assert len(committed(running.folder)) == 1


def test_a_run_whose_service_was_killed_goes_on_from_its_checkpoint(write: Write) -> None:
    longer = {"checkpoint": {"steps": 100}, "time__end": 32.0, "output__interval": 32.0}
    whole = run(write(**longer), "whole")
    running = started(write(**longer))
    running.wait_for((running.folder / FOLDER / "100" / "manifest.json").exists)
    running.processes(PROGRAM.name)[0].kill()
    assert running.process.wait(120) == 0, running.output
    assert "continuum/0 was lost" in running.output
    assert "going on from the checkpoint at step" in running.output
    assert differing(whole / "run.h5", running.folder / "run.h5") == []


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"continuum__flip": 0.9}, "continuum.damping: it has no damping"),
        ({"domain__periodic": [False, False]}, "coupling.planes: it has planes that run across"),
    ],
)
def test_it_refuses_what_it_cannot_do(write: Write, changes: dict[str, Any], reason: str) -> None:
    done = attempt(write(**changes))
    assert done.returncode == 2, done.stdout + done.stderr
    assert reason in done.stderr.replace("\n", " ")


def test_a_pulled_bar_alone_has_the_impulse_and_the_work_of_its_load(tmp_path: Path) -> None:
    """The momentum is the impulse as long as no wave has come back from the held end."""
    pull = {"condition": "traction", "value": [0.1, 0.02], "ramp": 1.0}
    held = {"condition": "velocity", "value": [0.0, 0.0]}
    bar = {
        "domain": {"box": [[0, 120], [0, 8]]},
        "grid.cell": 1,
        "time": {"end": 8.0, "step": 0.04},
        "boundary": {"left": held, "right": pull},
        "continuum.command": [str(PROGRAM)],
        "output": {"interval": 8.0, "energy_interval": 0.04},
    }
    case = tmp_path / "case.yaml"
    case.write_text(yaml.safe_dump(changed(CASE, CONTINUUM_ONLY | bar)))
    energies = Run(run(case)).energies
    impulse = np.array([0.1, 0.02]) * 8.0 * 7.5
    np.testing.assert_allclose(energies.continuum.momentum[-1], impulse, rtol=1e-3)
    work = energies.continuum.external_work[-1]
    assert work > 0.0
    assert abs(energies.energy[-1] - energies.energy[0] - work) < 1e-3 * work

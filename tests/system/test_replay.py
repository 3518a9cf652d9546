"""Recorded runs with LAMMPS and GIMP: each side is replayed, also one that was changed."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from gimpmd_deploy.results.run import Run
from gimpmd_schemas.checkpoint.manifest import FOLDER
from gimpmd_schemas.wire.recording import RECORDING, open_recording
from tests.cases import changed, small_case
from tests.running import Running
from tests.system.conftest import Command

pytestmark = pytest.mark.long

RECORDED = {"record": True, "time.end": 0.4, "output.interval": 0.4}
"""Ten coupling steps of two MD ranks and one of the continuum."""


@pytest.fixture
def recorded(finished, tmp_path: Path) -> Path:
    """A copy of a recorded run."""
    return shutil.copytree(finished(RECORDED).folder, tmp_path / "run", symlinks=True)


def replay(run: Path, side: str, *options: str) -> subprocess.CompletedProcess[str]:
    words = ["replay", str(run), "--side", side, "--force", *options]
    return subprocess.run(
        [sys.executable, "-m", "gimpmd_deploy.cli.app", *words],
        capture_output=True,
        text=True,
        timeout=250,
        check=False,
    )


@pytest.mark.parametrize(
    ("side", "said"),
    [("continuum", "22 payloads of md: same bits"), ("md", "20 payloads of continuum: same bits")],
)
def test_each_side_repeats_its_bits_alone(recorded: Path, side: str, said: str) -> None:
    done = replay(recorded, side)
    assert done.returncode == 0, done.stdout + done.stderr
    assert said in done.stdout
    # the record has the energies of both sides, since those of the other are played back too
    one, other = Run(recorded), Run(recorded.with_name(f"run-replay-{side}"))
    assert one.energies.energy.tobytes() == other.energies.energy.tobytes()


def test_atoms_with_another_potential_are_found_out(recorded: Path) -> None:
    """The potential is changed in a copy of the recorded run."""
    script = recorded / "input" / "crack.in"
    text = script.read_text()
    other = re.sub(r"^(pair_coeff\s+\* \*) 1(\.0)?\b", r"\1 1.0000001", text, flags=re.MULTILINE)
    assert other != text
    script.write_text(other)
    done = replay(recorded, "continuum")
    assert done.returncode == 3, done.stdout + done.stderr
    first = re.search(r"first difference: step (\d+), md/(\d), force at \d+ node", done.stdout)
    assert first, done.stdout
    assert int(first[1]) == 0
    assert "stopped" in Run(recorded.with_name("run-replay-continuum")).outcome
    done = replay(recorded, "continuum", "--go-on", "--tolerance", "1e-3", "--steps", "3")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "8 payloads of md: 0 differ by more than is accepted" in done.stdout
    assert "largest difference: step" in done.stdout


def test_a_recording_that_was_cut_off_is_replayed_as_far_as_it_goes(recorded: Path) -> None:
    path = recorded / RECORDING
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    done = replay(recorded, "continuum")
    assert done.returncode == 0, done.stdout + done.stderr
    found = re.search(r"the replay ends at step (\d+) of 10", done.stdout)
    assert found, done.stdout
    assert 2 <= int(found[1]) <= 6
    assert f"{2 * int(found[1]) + 2} payloads of md: same bits" in done.stdout


def test_the_side_that_runs_may_be_started_by_hand(recorded: Path, tmp_path: Path) -> None:
    words = ["replay", str(recorded), "--side", "md", "--by-hand", "--steps", "3"]
    words += ["--out", str(tmp_path / "x")]
    started = Running(
        [sys.executable, "-m", "gimpmd_deploy.cli.app", *words], tmp_path / "x", tmp_path / "said"
    )
    started.wait_for(lambda: "--patience" in started.output)
    command = started.output.partition("in another terminal:\n")[2].splitlines()[:3]
    subprocess.run(["/bin/sh", "-euc", "\n".join(command)], check=True, timeout=250)
    started.wait_for_end(60.0)
    assert started.process.returncode == 0, started.output
    assert "6 payloads of continuum: same bits" in started.output


def test_a_run_that_goes_on_has_each_step_once(command: Command, tmp_path: Path) -> None:
    more = {"checkpoint": {"steps": 4, "keep": 100}}
    whole = command.run(changed(small_case(), RECORDED | more)).folder
    rest = shutil.copytree(whole, tmp_path / "rest", symlinks=True)
    for name in ("8", "10"):
        shutil.rmtree(rest / FOLDER / name)
    words = command.arguments("resume", str(rest), "--no-figures")
    subprocess.run(words, check=True, capture_output=True, timeout=250)
    one, other = (_payloads(folder / RECORDING) for folder in (whole, rest))
    assert one == other
    assert len(one) == 11


def _payloads(path: Path) -> list[dict[str, bytes]]:
    """Bits of all fields of each step."""
    with open_recording(path) as recording:
        return [
            {
                f"{role}/{rank}/{name}": array.tobytes()
                for (role, rank), fields in step.payloads.items()
                for name, array in fields.items()
            }
            for step in recording.steps()
        ]

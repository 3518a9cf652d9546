"""Recorded runs with the service in Rust: one side is played back, the other one runs."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path
from typing import Any

import pytest

from gimpmd_deploy.results.run import Run
from tests.foreign.conftest import OURS, SAME, STEPS, Write
from tests.physics.sides import PROGRAM
from tests.small_run import GIMPMD

pytestmark = [pytest.mark.foreign, pytest.mark.timeout(1800)]


def recorded(case: Path) -> Path:
    """Run a case with ``record: true``; return the run folder."""
    folder = case.parent / "run"
    words = [GIMPMD, "run", str(case), "--out", str(folder), "--no-figures"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def replay(run: Path, side: str, *options: str) -> subprocess.CompletedProcess[str]:
    words = [GIMPMD, "replay", str(run), "--side", side, "--force", *options]
    return subprocess.run(words, capture_output=True, text=True, check=False)


def test_each_side_repeats_its_bits_against_the_other_one_played_back(write: Write) -> None:
    run = recorded(write(record=True, checkpoint=None))
    for side, said in (
        ("md", f"{STEPS} payloads of continuum: same bits"),  # the program runs
        ("continuum", f"{STEPS + 1} payloads of md: same bits"),  # LAMMPS runs
    ):
        done = replay(run, side)
        assert done.returncode == 0, done.stdout + done.stderr
        assert said in done.stdout
        energies = [Run(one).energies.energy for one in (run, run.with_name(f"run-replay-{side}"))]
        assert energies[0].tobytes() == energies[1].tobytes()


@pytest.mark.parametrize("absorber", [None, {}], ids=["plain", "absorber"])
def test_it_does_the_same_as_our_finite_elements(write: Write, absorber: Any) -> None:
    """A run with ours is recorded, and its atoms are played back to the program.

    The absorber sees more nodes, and pushes them.
    """
    run = recorded(write(record=True, checkpoint=None, coupling__absorber=absorber, **OURS))
    done = replay(run, "md", "--tolerance", repr(SAME), "--", str(PROGRAM))
    print(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{STEPS} payloads of continuum: 0 differ by more than is accepted" in done.stdout
    assert re.search(r"largest difference: step \d+", done.stdout)

"""Findings in the record of a run."""

from __future__ import annotations

from pathlib import Path

import h5py

from gimpmd_coupler.recorder import Recorder
from gimpmd_deploy.results.findings import RunFinding, read_findings
from gimpmd_schemas.wire.findings import check


def read(path: Path) -> tuple[RunFinding, ...]:
    with h5py.File(path) as file:
        return read_findings(file)


def test_findings_come_back_as_the_coupler_wrote_them(tmp_path: Path) -> None:
    with Recorder(tmp_path / "run.h5", "", "lj") as recorder:
        (bond,) = check("broken bond", 1.5, 1.25, (1.0, 2.0))
        recorder.add_finding("md", bond, 3, 0.5, "a bond \u2192 broken")
        (mass,) = check("mass", 0.1, 1e-9)
        recorder.add_finding("continuum", mass, 4, 0.75, "mass")
    first, second = read(tmp_path / "run.h5")
    assert first == RunFinding(
        step=3,
        time=0.5,
        side="md",
        kind="broken bond",
        value=1.5,
        limit=1.25,
        place=(1.0, 2.0),
        message="a bond \u2192 broken",
    )
    assert (second.side, second.kind, second.place) == ("continuum", "mass", None)


def test_a_sound_run_has_none(tmp_path: Path) -> None:
    with Recorder(tmp_path / "run.h5", "", "lj"):
        pass
    assert read(tmp_path / "run.h5") == ()

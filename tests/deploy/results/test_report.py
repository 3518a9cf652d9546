"""The summary of a run."""

import h5py
import numpy as np
import pytest

from gimpmd_coupler.recorder import FINDING
from gimpmd_deploy.results.report import make_report
from gimpmd_deploy.results.run import Run
from tests.deploy.results.files import write_record


def test_report_of_a_coupled_run(block):
    report = make_report(block)
    assert report.outcome == "completed"
    assert (report.steps, report.last_step) == (10, 10)
    assert report.end == pytest.approx(0.8)
    assert report.points == 1560
    assert report.atoms > 4000
    assert report.mass_change == 0.0
    assert 0.0 < report.energy == pytest.approx(report.external_work, rel=0.05)
    assert report.balance_scale == "external work"
    assert len(report.momentum) == 2
    assert report.findings == ()
    assert {"lammps", "wait"} <= set(report.timings["md"])
    assert {"step", "wait"} <= set(report.timings["continuum"])
    assert min(report.memory.values()) > 2**20


def test_report_of_a_finding(runs, tmp_path):
    for name in ("case.yaml", "plan.yaml"):
        (tmp_path / name).write_text((runs / "block" / name).read_text())
    write_record(tmp_path / "run.h5", [5.0, 6.9, 9.0], [0.0, 2.0, 4.0])
    with h5py.File(tmp_path / "run.h5", "a") as file:
        row = (1, 0.5, "md", "broken bond", 1.5, 1.25, (1.0, 3.0, np.nan), "a bond is broken")
        file["findings"] = np.array([row], FINDING)
    (finding,) = make_report(Run(tmp_path)).findings
    assert (finding.time, finding.side, finding.kind) == (0.5, "md", "broken bond")
    assert finding.place == (1.0, 3.0)


def test_momentum_of_three_dimensions(runs, tmp_path):
    for name in ("case.yaml", "plan.yaml"):
        (tmp_path / name).write_text((runs / "block-md" / name).read_text())
    write_record(tmp_path / "run.h5", [5.0, 6.9, 9.0], [0.0, 2.0, 4.0], dim=3)
    assert make_report(Run(tmp_path)).momentum == (1.0, 2.0, 3.0)


def test_a_run_that_recorded_no_step(runs, tmp_path):
    for name in ("case.yaml", "plan.yaml"):
        (tmp_path / name).write_text((runs / "block-md" / name).read_text())
    write_record(tmp_path / "run.h5", [5.0], [0.0])
    with h5py.File(tmp_path / "run.h5", "a") as file:
        del file["memory"]
    report = make_report(Run(tmp_path))
    assert (report.steps, report.steps_per_second) == (0, None)

"""A run folder, opened."""

import shutil

import h5py
import numpy as np
import pytest

from gimpmd_deploy.results.run import Run, find_time
from gimpmd_schemas.errors import InputError
from gimpmd_schemas.run_lock import take_lock


def test_find_time():
    times = [0.0, 10.0, 20.0]
    assert find_time(times, 9.97, near=0.04) == 1
    assert find_time(times, 9.95, near=0.04) is None
    assert find_time([], 0.0, near=1.0) is None


def test_a_finished_run(block):
    assert (block.plan.name, block.outcome) == ("block", "completed")
    assert block.seconds > 0.0
    np.testing.assert_allclose(block.times, [0.0, 0.4, 0.8])
    assert len(block.energies.time) == block.plan.steps + 1 == 11
    assert block.points(0.4).time == block.atoms(0.4).time == pytest.approx(0.4)
    assert block.atoms().time == pytest.approx(0.8)
    assert set(block.particles(0.4)) == {"md", "continuum"}
    assert block.particles(0.2) == {}
    assert "lammps" in block.timings.phases["md"]


def test_a_time_without_output(block):
    with pytest.raises(InputError, match=r"no atoms at this time\n.*at t = 0, 0\.4, 0\.8"):
        block.atoms(0.2)


def test_a_run_of_one_side(runs):
    alone = Run(runs / "block-md")
    assert set(alone.particles(0.8)) == {"md"}
    with pytest.raises(InputError, match="the run wrote no material points"):
        alone.points()


def test_a_folder_that_is_no_run(tmp_path):
    with pytest.raises(InputError, match=r"case\.yaml: is missing"):
        Run(tmp_path)


def test_a_run_without_a_plan(bench):
    with pytest.raises(InputError, match=r"plan\.yaml"):
        Run(bench.write().parent)


@pytest.fixture
def unwritten(runs, tmp_path):
    """A run that ended before it wrote anything."""
    for name in ("case.yaml", "plan.yaml"):
        (tmp_path / name).write_text((runs / "block" / name).read_text())
    return tmp_path


def test_a_run_without_output(unwritten):
    with pytest.raises(InputError, match="the run wrote no output"):
        _ = Run(unwritten).times


def test_a_damaged_record(unwritten):
    (unwritten / "run.h5").write_bytes(b"not HDF5")
    with pytest.raises(InputError, match=r"run\.h5.*\n.*is damaged"):
        _ = Run(unwritten).energies


def test_a_run_whose_processes_are_gone_is_lost_and_not_running(block, tmp_path):
    """Nothing could note the outcome: all processes were killed at once."""
    folder = tmp_path / "run"
    folder.mkdir()
    for name in ("case.yaml", "plan.yaml", "run.h5"):
        shutil.copy(block.folder / name, folder)
    with h5py.File(folder / "run.h5", "r+") as file:
        file.attrs["outcome"] = "running"
    with take_lock(folder):
        assert Run(folder).outcome == "running"
    assert Run(folder).outcome.startswith("lost: all processes were killed")

"""Wall time and memory from a record written by hand."""

import h5py
import pytest

from gimpmd_deploy.results.timings import Timings
from tests.deploy.results.files import write_record


@pytest.fixture
def timings(tmp_path):
    write_record(tmp_path / "run.h5", [5.0, 6.9, 9.0], [0.0, 2.0, 4.0])
    with h5py.File(tmp_path / "run.h5") as file:
        return Timings.read(file)


def test_phases_are_means_over_the_ranks(timings):
    assert timings.phases["md"]["lammps"].tolist() == [3.0, 3.0, 3.0]
    assert timings.totals() == {"md": {"lammps": 9.0, "wait": 1.5}}


def test_ranks_that_are_gone_do_not_count(tmp_path):
    """A run that goes on with fewer ranks leaves zeros in the columns of the others."""
    write_record(tmp_path / "run.h5", [5.0, 6.9, 9.0], [0.0, 2.0, 4.0])
    with h5py.File(tmp_path / "run.h5", "r+") as file:
        for phase in ("lammps", "wait"):
            file["timings/md"][phase][1:, 1] = 0.0
        found = Timings.read(file)
    assert found.phases["md"]["lammps"].tolist() == [3.0, 2.0, 2.0]
    assert found.phases["md"]["wait"].tolist() == [0.5, 1.0, 1.0]


def test_waiting_is_not_busy(timings):
    assert timings.busy == {"md/0": 6.0, "md/1": 12.0}


def test_memory_is_the_largest(timings):
    assert timings.memory == {"md/0": 30, "md/1": 9}


def test_to_dataframe(timings):
    assert timings.to_dataframe()["md_lammps"].sum() == 9.0

"""The record of a run."""

import h5py
import pytest

from gimpmd_deploy.results.record import Record
from gimpmd_schemas.errors import InputError
from tests.deploy.results.files import write_record


@pytest.fixture
def path(tmp_path):
    write_record(tmp_path / "run.h5", [5.0, 6.9, 9.0], [0.0, 2.0, 4.0])
    return tmp_path / "run.h5"


def test_record(path):
    record = Record.read(path)
    assert (record.outcome, record.seconds) == ("completed", 90.0)
    assert record.energies.time[-1] == 1.0
    assert "md" in record.timings.phases


def test_a_run_that_goes_on_has_no_duration(path):
    with h5py.File(path, "a") as file:
        del file.attrs["end"]
        file.attrs["outcome"] = "running"
    record = Record.read(path)
    assert (record.outcome, record.seconds) == ("running", None)


def test_a_run_that_ended_before_its_first_step(path):
    with h5py.File(path, "a") as file:
        del file["series"]
        file.attrs["outcome"] = "stopped"
    with pytest.raises(
        InputError, match=r"run\.h5.*\n.*holds no step; outcome of the run: stopped"
    ):
        Record.read(path)


def test_a_record_of_another_format(path):
    with h5py.File(path, "a") as file:
        file.attrs["format"] = 1
    with pytest.raises(InputError, match=r"run\.h5.*\n.*format = 1: has the layout of another.*\n"):
        Record.read(path)

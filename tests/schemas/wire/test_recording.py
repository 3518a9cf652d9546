"""Recordings: what is read of one that is whole, cut off, damaged, or of a run that failed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gimpmd_schemas.errors import InputError
from gimpmd_schemas.wire.messages import Refused, encode
from gimpmd_schemas.wire.recording import RecordedStep, open_recording
from tests.recordings import NEEDS, OFFERS, energies, fields, payload, report, write

MD, CONTINUUM = ("md", 1), ("continuum", 0)


def steps_of(path: Path) -> list[RecordedStep]:
    with open_recording(path) as recording:
        return list(recording.steps())


def test_ranks_and_steps_come_back(tmp_path: Path) -> None:
    write(tmp_path / "x", 3)
    with open_recording(tmp_path / "x") as recording:
        steps = list(recording.steps())
    assert recording.entries.keys() == OFFERS.keys()
    assert recording.senders("md") == {("md", 0), ("md", 1)}
    assert recording.senders() == OFFERS.keys()
    np.testing.assert_array_equal(recording.entries[MD].offers, OFFERS[MD])
    np.testing.assert_array_equal(recording.entries[MD].needs, NEEDS[MD])
    assert [one.step for one in steps] == [0, 1, 2, 3]
    assert all(one.payloads.keys() == OFFERS.keys() for one in steps)
    for name, array in fields(MD, 2).items():
        np.testing.assert_array_equal(steps[2].payloads[MD][name], array)
    assert steps[1].reports == {}
    assert steps[2].reports[CONTINUUM].energies == energies(2)
    assert recording.failure == ""


def test_each_step_ends_where_the_file_may_be_cut(tmp_path: Path) -> None:
    write(tmp_path / "x", 3)
    whole, data = steps_of(tmp_path / "x"), (tmp_path / "x").read_bytes()
    assert whole[-1].end == len(data)
    (tmp_path / "x").write_bytes(data[: whole[1].end])
    assert [one.end for one in steps_of(tmp_path / "x")] == [one.end for one in whole[:2]]


def test_a_file_that_was_cut_off_lacks_payloads_of_its_last_step(tmp_path: Path) -> None:
    write(tmp_path / "x", 3)
    (tmp_path / "x").write_bytes((tmp_path / "x").read_bytes()[:-20])
    last = steps_of(tmp_path / "x")[-1]
    assert (last.step, set(last.payloads)) == (3, {("continuum", 0), ("md", 0)})


def test_a_run_that_failed_says_why(tmp_path: Path) -> None:
    tail = (payload(MD, 4), payload(CONTINUUM, 4), payload(CONTINUUM, 5))
    write(tmp_path / "x", 3, *tail, encode(Refused(reason="md/0 was lost")))
    with open_recording(tmp_path / "x") as recording:
        found = {one.step: set(one.payloads) for one in recording.steps()}
    assert recording.failure == "md/0 was lost"
    assert found[4] == {MD, CONTINUUM}
    assert found[5] == {CONTINUUM}


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        pytest.param(payload(MD, 2), "a message of step 2", id="a step comes back"),
        pytest.param(report(MD, 6), "a message of step 6", id="a step is left out"),
        pytest.param(b"GMD1" + b"?" * 60, "damaged at byte", id="no frame"),
        pytest.param(payload(MD, 4)[:-8] + b"damaged!", "checksum", id="checksum"),
    ],
)
def test_damage_is_told_with_its_place(tmp_path: Path, more: bytes, reason: str) -> None:
    write(tmp_path / "x", 3, more)
    with pytest.raises(InputError, match=reason) as caught:
        steps_of(tmp_path / "x")
    assert "put the file back" in str(caught.value)
    assert "replay the steps before with --steps" in str(caught.value)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        steps_of(tmp_path / "x")

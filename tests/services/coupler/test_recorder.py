"""The record of a run, also of one that was killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from gimpmd_coupler import recorder as recorder_module
from gimpmd_coupler.recorder import FINDING, Recorder, conclude
from gimpmd_schemas.errors import InputError
from gimpmd_schemas.wire.energies import Energies, components
from gimpmd_schemas.wire.findings import MONITORS, check, sentence
from gimpmd_schemas.wire.messages import Array


def row(step: int, kinetic: float | None = None) -> dict[str, Array]:
    """What is recorded of one step."""
    columns = {"/series/step": np.array([step])}
    if kinetic is not None:
        columns["/series/md/kinetic"] = np.array([kinetic])
    return columns


def test_columns_have_units_and_one_value_per_step(tmp_path: Path) -> None:
    with Recorder(tmp_path / "run.h5", "name: x\n", "metal") as recorder:
        recorder.add(row(step=0, kinetic=1.5))
        recorder.flush()
        recorder.add(row(step=1, kinetic=2.5) | {"/timings/md/output": np.array([[0.25, 0.5]])})
        recorder.close("completed")
    with h5py.File(tmp_path / "run.h5") as file:
        np.testing.assert_array_equal(file["series/step"], [0, 1])
        np.testing.assert_array_equal(file["series/md/kinetic"], [1.5, 2.5])
        np.testing.assert_array_equal(file["timings/md/output"], [[0.0, 0.0], [0.25, 0.5]])
        units = [file[f"{path}"].attrs["units"] for path in ("series/md/kinetic", "series/step")]
        assert units == ["eV", "1"]
        assert file.attrs["outcome"] == "completed"
        assert file.attrs["case"] == "name: x\n"
        assert file.attrs["start"] <= file.attrs["end"]


def test_notes_are_kept_once(tmp_path: Path) -> None:
    with Recorder(tmp_path / "run.h5", "", "lj") as recorder:
        for sentences in ((), ("one", "two"), ("two", "three")):
            recorder.note(sentences)
    with h5py.File(tmp_path / "run.h5") as file:
        assert list(file.attrs["notes"]) == ["one", "two", "three"]


KILLED = """
import os, signal, sys
from pathlib import Path
import numpy as np
from gimpmd_coupler.recorder import FINDING, Recorder
from gimpmd_schemas.wire.findings import MONITORS, check, sentence
recorder = Recorder(Path(sys.argv[1]), "", "lj")
for step in range(3000):
    recorder.add({"/series/step": np.array([step])})
    if step % 1000 == 499:
        recorder.flush()
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_killed_run_leaves_all_up_to_the_last_flush(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    ended = subprocess.run([sys.executable, "-c", KILLED, str(path)], check=False, env=os.environ)
    assert ended.returncode == -signal.SIGKILL
    with h5py.File(path) as file:
        np.testing.assert_array_equal(file["series/step"], np.arange(2500))
        assert file.attrs["outcome"] == "running"
        assert "end" not in file.attrs


def test_it_can_be_read_while_it_is_written(tmp_path: Path) -> None:
    with Recorder(tmp_path / "run.h5", "", "lj") as recorder:
        recorder.add(row(0))
        recorder.flush()
        code = f"import h5py; print(h5py.File({str(tmp_path / 'run.h5')!r})['series/step'][:])"
        shown = subprocess.check_output([sys.executable, "-c", code], text=True)
        assert shown.strip() == "[0]"


def test_a_block_left_without_a_word_closes_the_file(tmp_path: Path) -> None:
    try:
        with Recorder(tmp_path / "run.h5", "", "lj"):
            raise RuntimeError
    except RuntimeError:
        pass
    with h5py.File(tmp_path / "run.h5") as file:
        assert file.attrs["outcome"].startswith("failed")


def test_a_record_goes_on_from_a_copy(tmp_path: Path) -> None:
    """Steps after the checkpoint are forgotten, and notes are not repeated."""
    copy, path = tmp_path / "copy.h5", tmp_path / "run.h5"
    with Recorder(copy, "name: x\n", "lj") as recorder:
        recorder.note(("one",))
        for step in range(10):
            recorder.add(row(step, 0.5 * step) | {"/memory/md": np.array([[step, 5, 6]])})
    with Recorder(path, "name: x\n", "lj", (copy, 6)) as recorder:
        recorder.note(("one", "two"))
        for step in range(6, 9):
            recorder.add(row(step, -1.0))
        recorder.close("completed")
    with h5py.File(path) as file:
        assert file["series/step"][:].tolist() == list(range(9))
        assert file["series/md/kinetic"][:].tolist() == [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, -1, -1, -1]
        assert file["memory/md"][:, 0].tolist() == [0, 1, 2, 3, 4, 5, 0, 0, 0]
        assert list(file.attrs["notes"]) == ["one", "two"]
        assert file.attrs["outcome"] == "completed"
    with h5py.File(copy) as file:
        assert len(file["series/step"]) == 10


def test_steps_are_added_several_at_once(tmp_path: Path) -> None:
    """A quantity that is left out for some steps is zero there."""
    steps = np.arange(10)
    with Recorder(tmp_path / "run.h5", "", "lj") as recorder:
        for some in np.split(steps, [1, 4, 6]):
            columns = {"/series/step": some}
            if some[0] != 4:
                columns["/timings/md/wait"] = some[:, None] + np.array([0.0, 0.5])
            recorder.add(columns)
    expected = steps[:, None] + np.array([0.0, 0.5])
    expected[4:6] = 0.0
    with h5py.File(tmp_path / "run.h5") as file:
        np.testing.assert_array_equal(file["series/step"], steps)
        np.testing.assert_array_equal(file["timings/md/wait"], expected)


@pytest.mark.parametrize("ranks", [1, 3])
def test_a_record_goes_on_with_other_ranks(tmp_path: Path, ranks: int) -> None:
    """Columns of ranks that do not take part are zero."""
    copy, path = tmp_path / "copy.h5", tmp_path / "run.h5"
    for target, earlier, count in ((copy, None, 2), (path, (copy, 1), ranks)):
        with Recorder(target, "", "lj", earlier) as recorder:
            for step in range(0 if earlier is None else 1, 3):
                recorder.add(row(step) | {"/memory/md": np.full((1, count), step + 7)})
    expected = np.zeros((3, max(2, ranks)))
    expected[0, :2], expected[1, :ranks], expected[2, :ranks] = 7, 8, 9
    with h5py.File(path) as file:
        np.testing.assert_array_equal(file["memory/md"], expected)


@pytest.mark.parametrize("ranks", [1, 2, 64, 512, 20_000])
def test_chunks_are_neither_tiny_nor_huge(tmp_path: Path, ranks: int) -> None:
    with Recorder(tmp_path / "run.h5", "", "lj") as recorder:
        recorder.add(row(0) | {"/timings/md/wait": np.ones((1, ranks))})
    with h5py.File(tmp_path / "run.h5") as file:
        wait = file["timings/md/wait"]
        assert 2**12 <= wait.dtype.itemsize * np.prod(wait.chunks) <= max(2**16, 4 * ranks)


def test_a_record_of_another_format_does_not_go_on(tmp_path: Path) -> None:
    copy = tmp_path / "copy.h5"
    Recorder(copy, "", "lj").close("stopped")
    with h5py.File(copy, "r+") as file:
        file.attrs["format"] = 1
    with pytest.raises(InputError, match=r"copy\.h5.*\n.*format = 1: has the layout of another"):
        Recorder(tmp_path / "run.h5", "", "lj", (copy, 1))


def test_wall_time_does_not_count_a_pause(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    monkeypatch.setattr(recorder_module.time, "monotonic", lambda: now)
    copy, path = tmp_path / "copy.h5", tmp_path / "run.h5"
    first = Recorder(copy, "", "lj")
    now += 5.0
    first.add(row(0))
    first.drop()
    now += 1000.0
    with Recorder(path, "", "lj", (copy, 1)):
        now += 2.0
    with h5py.File(path) as file:
        assert file.attrs["wall_time"] == 7.0


def test_a_record_goes_on_with_the_findings_up_to_the_checkpoint(tmp_path: Path) -> None:
    copy, path = tmp_path / "copy.h5", tmp_path / "run.h5"
    (strain,), (mass,) = check("strain", 0.2, 0.1, (1.0, 2.0)), check("mass", 0.1, 1e-9)
    with Recorder(copy, "", "lj") as recorder:
        for step in range(10):
            recorder.add(row(step))
        recorder.add_finding("continuum", strain, 5, 0.5, "strain")
        recorder.add_finding("md", mass, 6, 0.6, "mass")
        assert recorder.told() == {("continuum", "strain"): "strain", ("md", "mass"): "mass"}
    with Recorder(path, "", "lj", (copy, 6)) as recorder:
        recorder.add(row(6))
        assert recorder.told() == {("continuum", "strain"): "strain"}
        recorder.add_finding("md", mass, 6, 0.6, "mass again")
        assert recorder.told()[("md", "mass")] == "mass again"
    with h5py.File(path) as file:
        assert file["findings"]["step"].tolist() == [5, 6]
        assert len(file["series/step"]) == 7


def test_energies_of_a_side_are_read_from_the_record(tmp_path: Path) -> None:
    known = Energies(
        kinetic=0.1,
        potential=0.2,
        external_work=0.3,
        interface_work=0.0,
        dissipated=0.0,
        mass=1.0,
        momentum=(0.5, 0.6),
    )
    with Recorder(tmp_path / "run.h5", "", "lj") as recorder:
        for side in (known, None, known):
            values = components(side, 2)
            recorder.add({f"/series/md/{name}": np.array([x]) for name, x in values.items()})
        recorder.flush()
        assert recorder.sides("md", [0, 1]) == [known, None]
        assert recorder.sides("md", [2]) == [known]
        assert recorder.sides("md", []) == []


def test_the_longest_message_has_room() -> None:
    place = (-123456.789,) * 3
    for kind in MONITORS:
        (finding,) = check(kind, 1.2345e-300, -1.2345e-300, place)
        text = sentence("continuum", finding, 1.23456e-100)
        assert len(text.encode()) < FINDING["message"].itemsize


def test_the_first_step_is_on_disk_at_once(tmp_path: Path) -> None:
    with Recorder(tmp_path / "run.h5", "", "lj") as recorder:
        recorder.note(("a sentence",))
        for step in range(3):
            recorder.add(row(step))
        with h5py.File(tmp_path / "run.h5", locking=False) as file:
            assert list(file["series/step"]) == [0]
            assert list(file.attrs["notes"]) == ["a sentence"]


FULL = """
import resource, sys
from pathlib import Path
import numpy as np
from gimpmd_coupler.recorder import Recorder, conclude
from gimpmd_schemas.errors import StorageError
path = Path(sys.argv[1])
recorder = Recorder(path, "", "lj")
def row(step):
    return {"/series/step": np.array([step]), "/series/time": np.array([0.1 * step])}
recorder.add(row(0))
size = path.stat().st_size
resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))  # no file may grow beyond it
try:
    for step in range(1, 5000):
        recorder.add(row(step))
        if step % 100 == 0:
            recorder.flush()
except StorageError as error:
    recorder.drop()
    conclude(path, f"failed: {error}")
    print(step)
"""


def test_a_full_disk_leaves_the_record_of_the_last_flush_and_the_cause(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    done = subprocess.run(
        [sys.executable, "-c", FULL, str(path)], check=True, capture_output=True, text=True
    )
    last = int(done.stdout) - 100
    assert last > 500  # what fits into the chunks that are there needs no space
    with h5py.File(path) as file:
        np.testing.assert_array_equal(file["series/step"], np.arange(last + 1))
        assert file.attrs["outcome"] == f"failed: {path} cannot be written: File too large"
        assert "end" in file.attrs


def test_a_good_end_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    Recorder(path, "", "lj").close("completed")
    conclude(path, "failed: md was lost")
    with h5py.File(path) as file:
        assert file.attrs["outcome"] == "completed"

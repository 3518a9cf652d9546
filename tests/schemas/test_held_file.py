"""A file that changes on disk only when it is committed."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import h5py
import numpy as np
import pytest

from gimpmd_schemas import held_file
from gimpmd_schemas.errors import StorageError
from gimpmd_schemas.held_file import HeldFile


def test_it_is_like_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Random writes, cuts and commits on many pages, beside the same in a plain file."""
    monkeypatch.setattr(held_file, "_PAGE", 4096)
    random = np.random.default_rng(3)
    held, plain = HeldFile(tmp_path / "held", "w"), (tmp_path / "plain").open("w+b")
    for _ in range(400):
        place, count = int(random.integers(0, 30_000)), int(random.integers(0, 9_000))
        action = random.choice(["write", "read", "cut", "commit"], p=[0.5, 0.3, 0.1, 0.1])
        if action == "commit":
            held.commit()
            plain.flush()
            assert (tmp_path / "held").read_bytes() == (tmp_path / "plain").read_bytes()
            continue
        data, found = random.bytes(count), []
        for file in (held, plain):
            if action == "cut":
                file.truncate(place)
            else:
                file.seek(place)
                found.append(file.write(data) if action == "write" else file.read(count))
            found.append(file.seek(0, os.SEEK_END))
        assert found[: len(found) // 2] == found[len(found) // 2 :]
    plain.close()
    held.close()


def test_nothing_is_on_disk_before_the_commit(tmp_path: Path) -> None:
    path = tmp_path / "x"
    held = HeldFile(path, "w")
    held.write(b"one")
    held.commit()
    held.seek(0)
    held.write(b"other")
    assert path.read_bytes() == b"one"
    held.close()
    assert path.read_bytes() == b"one"
    again = HeldFile(path, "r+")
    assert again.read(10) == b"one"
    again.close()


@pytest.mark.parametrize("room", [0, 5000, 40_000])
def test_without_space_the_last_commit_stays_a_valid_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: int
) -> None:
    path = tmp_path / "x.h5"
    held = HeldFile(path, "w")
    file = h5py.File(held, "w")
    values = file.create_dataset("values", (0,), maxshape=(None,), chunks=(512,), dtype="f8")
    values.resize((500,))
    values[:] = 1.0
    file.flush()
    held.commit()
    before, limit, write = path.read_bytes(), path.stat().st_size + room, os.pwrite

    def full_disk(fd: int, data: memoryview, place: int) -> int:
        left = limit - place
        if left <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(fd, data[:left], place)

    monkeypatch.setattr(held_file.os, "pwrite", full_disk)
    values.resize((20_000,))
    values[500:] = 2.0
    file.flush()  # HDF5 does not notice
    with pytest.raises(StorageError, match=r"x\.h5 cannot be written: No space left on device"):
        held.commit()
    file.close()
    held.close()
    assert path.read_bytes() == before
    with h5py.File(path) as kept:
        np.testing.assert_array_equal(kept["values"], np.ones(500))


def test_a_deleted_file_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "x"
    held = HeldFile(path, "w")
    held.commit()
    path.unlink()
    with pytest.raises(StorageError, match="was deleted or replaced"):
        held.commit()
    path.write_text("another")
    with pytest.raises(StorageError, match="was deleted or replaced"):
        held.commit()
    held.close()


def test_a_file_that_cannot_be_opened(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match="No such file"):
        HeldFile(tmp_path / "none" / "x", "w")

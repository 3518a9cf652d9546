"""The lock on a run folder: who gets it, and how long it lasts."""

import fcntl
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gimpmd_schemas.errors import InputError, StorageError
from gimpmd_schemas.run_lock import MARK, is_locked, take_lock

TAKE = """
import sys
from pathlib import Path
from gimpmd_schemas.run_lock import take_lock
lock = take_lock(Path(sys.argv[1]))
print("taken", flush=True)
sys.stdin.read()
"""


def other_process(folder: Path) -> subprocess.Popen[str]:
    """A process that holds the lock until its input ends."""
    words = [sys.executable, "-c", TAKE, str(folder)]
    other = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert other.stdout.readline() == "taken\n"
    return other


def test_a_folder_belongs_to_one_process_until_it_ends(tmp_path: Path) -> None:
    assert not is_locked(tmp_path)
    with other_process(tmp_path) as other:
        assert is_locked(tmp_path)
        with pytest.raises(InputError, match=f"process {other.pid} on ") as caught:
            take_lock(tmp_path)
        assert caught.value.exit_code == 2
        other.kill()
        other.wait()
        assert not is_locked(tmp_path)
    take_lock(tmp_path).close()
    assert (tmp_path / MARK).read_text().startswith(f"run folder of gimpmd, process {os.getpid()}")


def test_the_lock_lasts_as_long_as_a_process_that_inherits_it(tmp_path: Path) -> None:
    lock = take_lock(tmp_path)
    with subprocess.Popen(["cat"], stdin=subprocess.PIPE, pass_fds=[lock.file]) as heir:
        lock.close()
        assert is_locked(tmp_path)
        heir.stdin.close()
        heir.wait()
    assert not is_locked(tmp_path)


def test_a_reader_that_looks_does_not_stop_a_run_from_starting(tmp_path: Path) -> None:
    take_lock(tmp_path).close()
    with (tmp_path / MARK).open() as reader:
        fcntl.flock(reader, fcntl.LOCK_SH)
        release = "import time, sys; time.sleep(0.2)"
        looking = subprocess.Popen([sys.executable, "-c", release], pass_fds=[reader.fileno()])
    start = time.monotonic()
    take_lock(tmp_path).close()
    assert time.monotonic() - start < 1.0
    looking.wait()


def test_a_folder_that_is_gone(tmp_path: Path) -> None:
    assert not is_locked(tmp_path / "none")
    with pytest.raises(StorageError, match="No such file"):
        take_lock(tmp_path / "none")


def test_a_file_system_without_locks_is_no_obstacle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(38, "Function not implemented")

    monkeypatch.setattr(fcntl, "flock", refuse)
    with take_lock(tmp_path):
        assert not is_locked(tmp_path)

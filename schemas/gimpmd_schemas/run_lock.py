"""The mark of a run folder, and the lock on it while a run goes on there.

The lock is on the open file, so it lasts until the last process that has inherited the file has
ended, however it ends. Nothing has to be cleaned up after a crash.
"""

from __future__ import annotations

import errno
import fcntl
import os
import socket
import time
from pathlib import Path
from types import TracebackType
from typing import Self

from gimpmd_schemas.errors import InputError, Problem, StorageError

MARK = ".gimpmd"
"""Name of the file that makes a folder a run folder. It says which process has the lock."""

_PATIENCE = 0.5
"""Seconds to wait for a reader, which holds the lock for a moment to see whether it is free."""


class RunLock:
    """The lock on a run folder; see `take_lock`. Nobody needs to close it who drops it.

    Attributes
    ----------
    file : int
        File descriptor for child processes to inherit.
    """

    def __init__(self, file: int) -> None:
        self.file = file

    def close(self) -> None:
        """Release the lock, unless a child process still has it."""
        if self.file >= 0:
            os.close(self.file)
        self.file = -1

    def __del__(self) -> None:
        self.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self.close()


def take_lock(folder: Path) -> RunLock:
    """Mark a folder as a run folder, and lock it.

    Raises
    ------
    InputError
        A run is going on in the folder. A file system without locks cannot tell.
    StorageError
        The folder cannot be written.
    """
    mark = folder / MARK
    try:
        file = os.open(mark, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise StorageError(f"{mark} cannot be written: {error.strerror}") from None
    lock = RunLock(file)
    deadline = time.monotonic() + _PATIENCE
    while _is_taken(file, fcntl.LOCK_EX):
        if time.monotonic() > deadline:
            lock.close()
            raise in_use(folder)
        time.sleep(0.02)
    words = f"run folder of gimpmd, process {os.getpid()} on {socket.gethostname()}\n".encode()
    try:
        os.pwrite(file, words, 0)
        os.ftruncate(file, len(words))
    except OSError as error:
        lock.close()
        raise StorageError(f"{mark} cannot be written: {error.strerror}") from None
    return lock


def is_locked(folder: Path) -> bool:
    """Whether a run goes on in a folder; false as well where the file system has no locks."""
    try:
        file = os.open(folder / MARK, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        return _is_taken(file, fcntl.LOCK_SH)
    finally:
        os.close(file)


def in_use(folder: Path) -> InputError:
    """Return the error for a folder in which a run goes on."""
    words = (folder / MARK).read_text(errors="replace").strip().partition(", ")[2]
    message = f"a run is going on in this folder ({words})" if words else "a run is going on there"
    hint = "choose another folder with --out, or end that run first"
    return InputError(str(folder), [Problem("--out", None, message, hint)])


def _is_taken(file: int, kind: int) -> bool:
    """Try to take a lock; returns whether another process has it."""
    try:
        fcntl.flock(file, kind | fcntl.LOCK_NB)
    except OSError as error:  # others than these: the file system has no locks
        return error.errno in (errno.EWOULDBLOCK, errno.EACCES)
    return False

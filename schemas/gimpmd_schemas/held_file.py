"""A file that is held back in memory and changes on disk only when it is committed.

HDF5 cannot cope with a full disk: a failed write leaves its file damaged, and closing the file may
crash the process. So HDF5 writes into this object, where no write fails. A commit first appends
what is new, which is all that needs space. Only when that has worked does it change what was there
before.
"""

from __future__ import annotations

import io
import os
from pathlib import Path

from gimpmd_schemas.errors import StorageError

_PAGE = 2**16


class HeldFile:
    """A file for ``h5py.File``; see the module.

    Parameters
    ----------
    path : Path
    mode : str
        ``w`` makes a new file, ``r+`` changes one that exists.

    Raises
    ------
    StorageError
        The file cannot be opened.
    """

    def __init__(self, path: Path, mode: str) -> None:
        self._path = path
        flags = os.O_RDWR | os.O_CLOEXEC | (os.O_CREAT | os.O_TRUNC if mode == "w" else 0)
        try:
            self._fd = os.open(path, flags, 0o666)
        except OSError as error:
            raise _storage_error(path, error) from None
        self._size = self._committed = os.fstat(self._fd).st_size
        self._pages: dict[int, bytearray] = {}  # written since the last commit, by number
        self._at = 0

    # What h5py calls

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Move to a place; returns it."""
        self._at = offset + {io.SEEK_SET: 0, io.SEEK_CUR: self._at, io.SEEK_END: self._size}[whence]
        return self._at

    def tell(self) -> int:
        """Return the place."""
        return self._at

    def read(self, count: int) -> bytes:
        """Return so many bytes from the place on, or fewer at the end of the file."""
        start = self._at
        self._at = max(start, min(start + count, self._size))
        return bytes(self._bytes(start, self._at))

    def write(self, data: memoryview) -> int:
        """Write at the place; returns the number of bytes."""
        view, done = memoryview(data).cast("B"), 0
        while done < len(view):
            number, start = divmod(self._at, _PAGE)
            count = min(_PAGE - start, len(view) - done)
            if number not in self._pages:
                self._pages[number] = self._page(number)
            self._pages[number][start : start + count] = view[done : done + count]
            done += count
            self._at += count
        self._size = max(self._size, self._at)
        return done

    def truncate(self, size: int) -> int:
        """Set the size; new bytes are zero."""
        last, start = divmod(size, _PAGE)
        for number in range(last, _pages_in(max(self._size, self._committed))):
            self._pages[number] = self._page(number)
            self._pages[number][start:] = bytes(_PAGE - start)
            start = 0
        self._size = size
        return size

    def flush(self) -> None:
        """Do nothing: see `commit`."""

    # What the owner calls

    def commit(self) -> None:
        """Bring the file on disk to the present state.

        Raises
        ------
        StorageError
            There is no space, or the file was deleted. The file on disk keeps the state of the
            last commit.
        """
        self._check_place()
        old, new = self._committed, self._size
        try:
            self._put(old, self._bytes(old, new))
        except OSError as error:
            os.ftruncate(self._fd, old)
            raise _storage_error(self._path, error) from None
        try:
            for start in (_PAGE * number for number in sorted(self._pages)):
                self._put(start, self._bytes(start, min(start + _PAGE, old, new)))
            os.ftruncate(self._fd, new)
        except OSError as error:
            raise _storage_error(self._path, error) from None
        self._pages.clear()
        self._committed = new

    def close(self) -> None:
        """Close the file; what was not committed is lost."""
        if self._fd >= 0:
            os.close(self._fd)
        self._fd = -1

    def _page(self, number: int) -> bytearray:
        """A page as it stands now; the caller may change it if it is held."""
        if number in self._pages:
            return self._pages[number]
        start = number * _PAGE
        known = max(0, min(_PAGE, self._committed - start))
        return bytearray(os.pread(self._fd, known, start).ljust(_PAGE, b"\0"))

    def _bytes(self, start: int, end: int) -> memoryview:
        """Content between two places as it stands now."""
        first = start // _PAGE
        pages = b"".join(self._page(number) for number in range(first, _pages_in(end)))
        return memoryview(pages)[start - first * _PAGE : end - first * _PAGE]

    def _put(self, place: int, data: memoryview) -> None:
        """Write to the disk."""
        while data:
            count = os.pwrite(self._fd, data, place)
            place, data = place + count, data[count:]

    def _check_place(self) -> None:
        try:
            there = os.path.samestat(os.stat(self._path), os.fstat(self._fd))
        except FileNotFoundError:
            there = False
        if not there:
            raise StorageError(f"{self._path} was deleted or replaced while the run went on")


def _pages_in(size: int) -> int:
    """Number of pages that hold so many bytes."""
    return -(-size // _PAGE)


def _storage_error(path: Path, error: OSError) -> StorageError:
    return StorageError(f"{path} cannot be written: {error.strerror}")

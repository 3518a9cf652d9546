"""Files that are on disk whole, or not at all."""

from __future__ import annotations

import os
from pathlib import Path


def write_at_once(path: Path, data: bytes) -> None:
    """Write a file, wait until it is on disk, then give it its name.

    Whatever happens, a reader finds the whole file, or the one that was there before.

    Raises
    ------
    OSError
        The disk is full, or the folder is gone.
    """
    partial = path.with_name(f"{path.name}.part")
    partial.write_bytes(data)
    sync(partial)
    partial.replace(path)
    sync(path.parent)


def sync(path: Path) -> None:
    """Wait until a file, or the names in a folder, are on disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)

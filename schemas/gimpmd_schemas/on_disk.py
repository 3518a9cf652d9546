"""Files that are on disk whole, or not at all; folders in a run folder."""

from __future__ import annotations

import os
from pathlib import Path

from gimpmd_schemas.errors import InputError, Problem


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


def folder_of_logs(run_dir: Path) -> Path:
    """Return the folder of logs, and make it if it is missing.

    A run folder that is missing is not made: whoever deleted it would find half of one.

    Raises
    ------
    InputError
        There is no run folder.
    """
    logs = run_dir / "logs"
    try:
        logs.mkdir(exist_ok=True)
    except FileNotFoundError:
        hint = "start the run again: gimpmd run makes it"
        problem = Problem("--run-dir", str(run_dir), "there is no such folder", hint)
        raise InputError("the run folder", [problem]) from None
    return logs

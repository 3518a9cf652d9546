"""Output files of a run that goes on from a checkpoint: what was written after it is cut off."""

from __future__ import annotations

import os
from pathlib import Path

from gimpmd_schemas.errors import BackendError


def cut_file(path: Path, length: int) -> None:
    """Cut a file that only grows at its end to the length that it had at the checkpoint.

    Raises
    ------
    BackendError
        The file is shorter, or it is gone: somebody has changed it.
    """
    size = path.stat().st_size if path.is_file() else 0
    if size < length:
        raise BackendError(
            f"{path} has {size} bytes, but it had {length} at the checkpoint; put the file back to "
            "go on"
        )
    if path.is_file():
        os.truncate(path, length)

"""The version of the layout of ``run.h5``, and the check of it.

The layout is described in `docs/run-folder.md`.
"""

from __future__ import annotations

from pathlib import Path

import h5py

from gimpmd_schemas.errors import InputError, Problem

FORMAT_VERSION = 2


def check_format(path: Path, file: h5py.File) -> None:
    """Check that a record has the layout that this version of gimpmd reads and writes.

    Parameters
    ----------
    path : Path
        Of the file, for the message.
    file : h5py.File
        The record, open.

    Raises
    ------
    InputError
        It has another one.
    """
    found = file.attrs["format"]
    if found != FORMAT_VERSION:
        what = f"has the layout of another version of gimpmd; this one has {FORMAT_VERSION}"
        hint = "run the case again, or rewrite the file as CHANGELOG.md says"
        raise InputError(str(path), [Problem("format", int(found), what, hint)])

"""The program of a continuum service in any language, `continuum.command`."""

from __future__ import annotations

import shutil
from pathlib import Path

import msgspec

from gimpmd_schemas.case.form import Case


def program(name: str, folder: Path) -> str | None:
    """Find a program.

    Parameters
    ----------
    name : str
        With a slash: a path from ``folder``. Other names are looked for on the PATH.
    folder : Path
        Folder of the case.

    Returns
    -------
    str or None
        Its full path; None if there is no such program.
    """
    found = shutil.which(folder / name if "/" in name else name)
    return None if found is None else str(Path(found).absolute())


def with_program(case: Case, folder: Path) -> Case:
    """Return the case with the full path of the program in ``continuum.command``.

    The program has been found before (`check_files`).
    """
    words = case.continuum.command
    if not words or (found := program(words[0], folder)) is None:
        return case
    continuum = msgspec.structs.replace(case.continuum, command=(found, *words[1:]))
    return msgspec.structs.replace(case, continuum=continuum)

"""Whether a case is that of the run in a folder, so that the run can go on with it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from gimpmd_schemas.case.derive.scripts import input_files
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import load_case
from gimpmd_schemas.errors import InputError, Problem

FREE = ("time.end", "md.ranks", "md.patches", "continuum.ranks", "continuum.patches")
"""Keys that may have other values when a run goes on."""


def check_same_case(case: Case, path: Path, folder: Path) -> None:
    """Check that a case is that of the run in a folder, but for its end and its ranks.

    Parameters
    ----------
    case : Case
    path, folder : Path
        The case file, and the run folder.

    Raises
    ------
    InputError
        Lists all keys and files that differ.
    """
    hint = f"start a new run with --force or --out, or go on with gimpmd resume {folder} --until"
    mine, theirs = (dict(_values(one)) for one in (case, load_case(folder / "case.yaml")))
    problems = [
        Problem(key, mine.get(key), f"the run in {folder} has {theirs.get(key)!r}", hint)
        for key in {**mine, **theirs}
        if mine.get(key) != theirs.get(key)
    ]
    problems += [
        Problem(key, name, f"the run in {folder} has another content in input/{name}", hint)
        for key, name in input_files(case)
        if not _same(path.parent / name, folder / "input" / name)
    ]
    if problems:
        raise InputError(str(path), problems)


def _values(case: Case) -> Iterator[tuple[str, Any]]:
    """Dotted keys of a case and their values, without those that are free."""

    def below(key: str, value: Any) -> Iterator[tuple[str, Any]]:
        if not isinstance(value, dict):
            yield key, value
            return
        for name, part in value.items():
            yield from below(f"{key}.{name}" if key else name, part)

    pairs = below("", msgspec.to_builtins(case, str_keys=True))
    return ((key, value) for key, value in pairs if key not in FREE)


def _same(one: Path, other: Path) -> bool:
    return other.is_file() and one.read_bytes() == other.read_bytes()

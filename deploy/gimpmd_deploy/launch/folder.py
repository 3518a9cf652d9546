"""The run folder: whether it can be made, and what lies in it before a run starts."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from pathlib import Path

from gimpmd_deploy.launch.resume import unfinished
from gimpmd_schemas.case.derive.scripts import input_files
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import dump_case
from gimpmd_schemas.case.plan import Plan, write_plan
from gimpmd_schemas.errors import InputError, Problem, StorageError
from gimpmd_schemas.run_lock import MARK, RunLock, in_use, is_locked, take_lock
from gimpmd_schemas.wire.recording import RECORDING
from gimpmd_schemas.wire.replay import REPLAY

WRITTEN = (
    "case.yaml",
    "plan.yaml",
    "input",
    "run.h5",
    "fields",
    "atoms",
    "figures",
    "logs",
    "keys",
    "bus",
    "checkpoints",
    RECORDING,
    REPLAY,
    "job.sh",
)
"""What a run writes in its folder, and all that ``--force`` removes."""

_ROOM = 1 << 20
"""Bytes: a disk with less free space counts as full."""


def check_folder(folder: Path, source: Path, force: bool) -> None:
    """Check that a run folder can be made, without making it.

    Parameters
    ----------
    folder, source : Path
        The run folder, and the folder of its case.
    force : bool
        Whether an earlier run in the folder may be overwritten.

    Raises
    ------
    InputError
        Something is there already, a run is going on there, or the place is not writable.
    """

    def refuse(message: str, hint: str) -> InputError:
        return InputError(str(folder), [Problem("--out", None, message, hint)])

    if is_locked(folder):
        raise in_use(folder)
    if folder.resolve() == source.resolve():
        raise refuse("this is the folder of the case itself", "choose another place with --out")
    existing = next(parent for parent in (folder, *folder.parents) if os.path.lexists(parent))
    if not existing.is_dir():
        raise refuse(f"{existing} is not a folder", "choose another place with --out")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise refuse(f"no permission to write in {existing}", "choose another place with --out")
    _check_content(folder, force)


def _check_content(folder: Path, force: bool) -> None:
    """Check that what lies in a folder may be overwritten."""
    present = {path.name for path in folder.iterdir()} if folder.exists() else set()
    if present <= {MARK}:
        return
    if MARK not in present:
        message = "the folder is not empty, and it holds no run"
        hint = f"choose another with --out; --force overwrites only folders with the file {MARK}"
    elif force:
        return
    elif (left := unfinished(folder)) is not None:
        message = (
            f"the run in this folder is not finished; its last checkpoint is at t = {left.time:g}"
        )
        hint = f"go on with gimpmd resume {folder}, or overwrite it with --force"
    else:
        message = "the folder is not empty"
        hint = "choose another with --out, or overwrite the run in it with --force"
    raise InputError(str(folder), [Problem("--out", None, message, hint)])


def make_folder(case: Case, plan: Plan, source: Path, folder: Path, force: bool) -> RunLock:
    """Make a run folder: the case, its plan, and copies of its files in ``input/``.

    What lies in the folder is looked at once more: another run may have begun there since
    `check_folder`.

    Parameters
    ----------
    case : Case
        As the user wrote it.
    plan : Plan
        What is about to run.
    source, folder : Path
        Where the files of the case lie, and where the run goes.
    force : bool
        Whether an earlier run in the folder may be overwritten.

    Returns
    -------
    RunLock
        The folder is locked until it is closed.

    Raises
    ------
    InputError
        Another run has begun in the folder.
    StorageError
        The folder cannot be written.
    """
    _check_content(folder, force)  # before the mark is made, and again when nobody else can write
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = take_lock(folder)
    except OSError as error:
        raise StorageError(f"{folder} cannot be made: {error.strerror}") from None
    except StorageError:
        _leave(folder)
        raise
    try:
        _check_content(folder, force)
        _remove(folder)
        _fill(case, plan, source, folder)
    except InputError:
        lock.close()
        raise
    except OSError as error:
        _remove(folder)
        _leave(folder)
        lock.close()
        raise StorageError(f"{folder} cannot be written: {error.strerror}") from None
    return lock


def _remove(folder: Path) -> None:
    """Remove what a run has written."""
    for name in WRITTEN:
        old = folder / name
        if old.is_dir() and not old.is_symlink():
            shutil.rmtree(old)
        else:
            old.unlink(missing_ok=True)


def _leave(folder: Path) -> None:
    """Remove the mark, and the folder itself if nothing else is in it."""
    (folder / MARK).unlink(missing_ok=True)
    if not any(folder.iterdir()):
        folder.rmdir()


def _fill(case: Case, plan: Plan, source: Path, folder: Path) -> None:
    for name in ("input", "fields", "atoms", "figures", "logs"):
        (folder / name).mkdir()
    copy_input(case, source, folder / "input")
    dump_case(case, folder / "case.yaml")
    write_plan(plan, folder / "plan.yaml")


def copy_input(case: Case, source: Path, target: Path) -> None:
    """Copy the files that the services read, each under its own name."""
    for _, name in input_files(case):
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source / name, target / name)


def storage_trouble(folder: Path, said: str) -> str:
    """Return why nothing can be written in a run folder; an empty text if something can.

    Parameters
    ----------
    said : str
        What the process said that failed. Its own files may have been too large for the space that
        is left.
    """
    if not folder.is_dir():
        return "it was deleted"
    for reason in map(os.strerror, (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG)):
        if reason in said:
            return reason
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(bytes(_ROOM))
    except OSError as error:
        return error.strerror or str(error)
    return ""

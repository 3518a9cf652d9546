"""The run folder: whether it can be made, and what lies in it before a run starts."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from gimpmd_deploy.launch.resume import unfinished
from gimpmd_schemas.case.derive.scripts import scripts
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import dump_case
from gimpmd_schemas.case.plan import Plan, write_plan
from gimpmd_schemas.errors import InputError, Problem

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
    "job.sh",
)
"""What a run writes in its folder, and all that ``--force`` removes."""


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
        Something is there already, or the place is not writable.
    """

    def refuse(message: str, hint: str) -> InputError:
        return InputError(str(folder), [Problem("--out", None, message, hint)])

    if folder.resolve() == source.resolve():
        raise refuse("this is the folder of the case itself", "choose another place with --out")
    existing = next(parent for parent in (folder, *folder.parents) if os.path.lexists(parent))
    if not existing.is_dir():
        raise refuse(f"{existing} is not a folder", "choose another place with --out")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise refuse(f"no permission to write in {existing}", "choose another place with --out")
    if existing == folder and any(folder.iterdir()) and not force:
        left = unfinished(folder)
        if left is not None:
            raise refuse(
                f"the run in this folder is not finished; its last checkpoint is at t = "
                f"{left.time:g}",
                f"go on with gimpmd resume {folder}, or overwrite it with --force",
            )
        raise refuse(
            "the folder is not empty",
            "choose another with --out, or overwrite the run in it with --force",
        )


def make_folder(case: Case, plan: Plan, source: Path, folder: Path) -> None:
    """Make a run folder: the case, its plan, and copies of its scripts in ``input/``.

    Parameters
    ----------
    case : Case
        As the user wrote it.
    plan : Plan
        What is about to run.
    source, folder : Path
        Where the scripts of the case lie, and where the run goes.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name in WRITTEN:
        old = folder / name
        if old.is_dir() and not old.is_symlink():
            shutil.rmtree(old)
        else:
            old.unlink(missing_ok=True)
    for name in ("input", "fields", "atoms", "figures", "logs"):
        (folder / name).mkdir()
    copy_scripts(case, source, folder / "input")
    dump_case(case, folder / "case.yaml")
    write_plan(plan, folder / "plan.yaml")


def copy_scripts(case: Case, source: Path, target: Path) -> None:
    """Copy the files that LAMMPS reads, each under its own name."""
    for _, name in scripts(case):
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source / name, target / name)

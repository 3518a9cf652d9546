"""Go on with a run from its last checkpoint."""

from __future__ import annotations

import shutil
from pathlib import Path

import h5py
import msgspec

from gimpmd_deploy.launch.services import RunServices, services_of
from gimpmd_schemas.case.derive import regions, times
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import dump_case, load_case
from gimpmd_schemas.case.plan import Plan, load_plan, write_plan
from gimpmd_schemas.checkpoint.manifest import (
    FOLDER,
    Manifest,
    committed,
    damage,
    folder_of,
)
from gimpmd_schemas.errors import GimpmdError, InputError, Problem, StorageError
from gimpmd_schemas.run_lock import RunLock, take_lock
from gimpmd_schemas.wire.replay import REPLAY


class ResumedRun(msgspec.Struct, frozen=True):
    """A run that is ready to go on.

    Attributes
    ----------
    plan : with the new end and ranks.
    folder : the run folder.
    services : the commands of its services.
    lock : on the run folder.
    start : the checkpoint from which it goes on.
    notes : what the user should know about the checkpoints, one sentence each.
    """

    plan: Plan
    folder: Path
    services: RunServices
    lock: RunLock
    start: Manifest
    notes: tuple[str, ...]


def make_ready_again(
    folder: Path, until: float | None, ranks_md: int | None, ranks_gimp: int | None
) -> ResumedRun:
    """Find the last whole checkpoint of a run, and write the plan of the rest of it.

    Checkpoints that are damaged are renamed to ``<step>.damaged``.

    Parameters
    ----------
    folder : Path
        The run folder.
    until : float, optional
        New end time, at or after that of the checkpoint.
    ranks_md, ranks_gimp : int, optional
        New numbers of MPI ranks.

    Raises
    ------
    InputError
        There is no run, a run is going on, no checkpoint, or nothing left to do.
    StorageError
        The folder cannot be written.
    """
    if not (folder / "plan.yaml").is_file():
        raise _refuse(folder, "there is no run in this folder", "start one with gimpmd run")
    if (folder / REPLAY).exists():
        raise _refuse(folder, "a replay cannot go on", "start it again with gimpmd replay --force")
    lock = take_lock(folder)
    try:
        return _make_ready_again(folder, until, ranks_md, ranks_gimp, lock)
    except GimpmdError:
        lock.close()
        raise


def _make_ready_again(
    folder: Path, until: float | None, ranks_md: int | None, ranks_gimp: int | None, lock: RunLock
) -> ResumedRun:
    plan, case = load_plan(folder / "plan.yaml"), load_case(folder / "case.yaml")
    start, notes = _last_whole(folder)
    if start is None:
        reason = " ".join(("the run has no checkpoint to go on from", *notes))
        raise _refuse(folder, reason, "run it again with gimpmd run --force")
    before = plan
    case, plan = _changed(case, plan, until, ranks_md, ranks_gimp)
    if plan.record and any(plan.ranks(role) != before.ranks(role) for role in plan.roles):
        raise _refuse(
            folder,
            "a run that is recorded goes on with the ranks that it had",
            "leave out --ranks-md and --ranks-gimp",
        )
    if plan.steps < start.step or (plan.steps == start.step and _is_complete(folder)):
        raise _refuse(
            folder,
            f"its last checkpoint, at t = {start.time:g}, is not before the end of the run, "
            f"t = {plan.steps * plan.step:g}",
            "give a later end with --until",
        )
    services = services_of(plan, folder)
    try:
        drop_unfinished(folder, start.step)
        dump_case(case, folder / "case.yaml")
        write_plan(plan, folder / "plan.yaml")
    except OSError as error:
        raise StorageError(f"{folder} cannot be written: {error.strerror}") from None
    return ResumedRun(plan, folder, services, lock, start, tuple(notes))


def drop_unfinished(folder: Path, step: int) -> None:
    """Remove what ranks have saved after the last checkpoint that counts."""
    for path in (folder / FOLDER).iterdir():
        if path.name.isdigit() and int(path.name) > step:
            shutil.rmtree(path)


def unfinished(folder: Path) -> Manifest | None:
    """The last checkpoint of a run that ended before its end time; None if there is none."""
    if not (folder / "plan.yaml").is_file():
        return None
    found = committed(folder)
    whole = found and found[0].step < load_plan(folder / "plan.yaml").steps
    return found[0] if whole else None


def _is_complete(folder: Path) -> bool:
    """Whether the record of a run says that it came to its end."""
    try:
        with h5py.File(folder / "run.h5") as file:
            return str(file.attrs["outcome"]) == "completed"
    except (OSError, KeyError):  # gone or damaged: the checkpoint has a copy
        return False


def _last_whole(folder: Path) -> tuple[Manifest | None, list[str]]:
    """The last checkpoint that is not damaged, and a sentence on each one that is."""
    notes: list[str] = []
    for manifest in committed(folder):
        reason = damage(folder, manifest)
        if not reason:
            return manifest, notes
        place = folder_of(folder, manifest.step)
        place.rename(place.with_name(f"{place.name}.damaged"))
        notes.append(f"the checkpoint of step {manifest.step} is left out: {reason}")
    return None, notes


def _changed(
    case: Case, plan: Plan, until: float | None, ranks_md: int | None, ranks_gimp: int | None
) -> tuple[Case, Plan]:
    """Case and plan with a new end and other ranks."""
    replace = msgspec.structs.replace
    if until is not None:
        case = replace(case, time=replace(case.time, end=until))
        plan = replace(plan, steps=times.steps_until(plan.step, plan.energies_every, until))
    if ranks_md is not None and plan.md is not None:
        case = replace(case, md=replace(case.atoms, ranks=ranks_md, patches="auto"))
        md = replace(plan.md, ranks=ranks_md, patches=regions.md_patches(case))
        plan = replace(plan, md=md)
    if ranks_gimp is not None:
        case = replace(case, continuum=replace(case.continuum, ranks=ranks_gimp, patches="auto"))
        patches = None if plan.continuum.patches is None else regions.continuum_patches(case)
        continuum = replace(plan.continuum, ranks=ranks_gimp, patches=patches)
        plan = replace(plan, continuum=continuum)
    return case, plan


def _refuse(folder: Path, message: str, hint: str) -> InputError:
    return InputError(str(folder), [Problem("RUN", None, message, hint)])

"""A whole run: from a checked case to the outcome."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gimpmd_deploy.launch.asking import ask_lammps, needs_lammps
from gimpmd_deploy.launch.folder import check_folder, make_folder
from gimpmd_deploy.launch.services import RunServices, services_of
from gimpmd_deploy.launch.supervise import Outcome, Watcher, supervise
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.errors import GimpmdError
from gimpmd_schemas.resolve import resolve
from gimpmd_schemas.wire.answers import Probe


@dataclass(frozen=True)
class ReadyRun:
    """A run that is ready to start.

    Attributes
    ----------
    case : Case
        As the user wrote it.
    probe : Probe
        What LAMMPS answered; empty if the case does not need LAMMPS.
    plan : Plan
    folder : Path
        The run folder, with the case, the plan and the scripts in it.
    services : RunServices
    """

    case: Case
    probe: Probe
    plan: Plan
    folder: Path
    services: RunServices


def ask(case: Case, path: Path) -> Probe:
    """Return what LAMMPS answers, or an empty answer if the case does not need LAMMPS.

    Raises
    ------
    BackendError, PeerLostError
        See `ask_lammps`.
    """
    return ask_lammps(case, path) if needs_lammps(case) else Probe()


def default_folder(case: Case) -> Path:
    """Return ``runs/NAME``, or ``runs/NAME-SIDE`` for a run of one side."""
    return Path("runs") / (f"{case.name}-{case.only}" if case.only else case.name)


def make_ready(case: Case, path: Path, folder: Path, force: bool) -> ReadyRun:
    """Find everything that can be wrong with a run, then make its folder.

    Parameters
    ----------
    case : Case
        Checked.
    path : Path
        The case file, for its scripts and for messages.
    folder : Path
        The run folder.
    force : bool
        Whether an earlier run in the folder may be overwritten.

    Raises
    ------
    InputError
        The case cannot run, or the folder cannot be used.
    BackendError, PeerLostError
        LAMMPS refused a script, the MD service crashed, or ``mpiexec`` is missing.
    """
    probe, plan = _make_plan(case, path, folder, force)
    services = services_of(plan, folder)
    make_folder(case, plan, path.parent, folder)
    return ReadyRun(case, probe, plan, folder, services)


def make_run_folder(case: Case, path: Path, folder: Path, force: bool) -> tuple[Probe, Plan]:
    """Make the folder of a run that is started by hand; see `make_ready`."""
    probe, plan = _make_plan(case, path, folder, force)
    make_folder(case, plan, path.parent, folder)
    return probe, plan


def _make_plan(case: Case, path: Path, folder: Path, force: bool) -> tuple[Probe, Plan]:
    check_folder(folder, path.parent, force)
    probe = ask(case, path)
    return probe, resolve(case, probe, path)


def start(ready: ReadyRun, watcher: Watcher) -> Outcome:
    """Run to the end; the errors of `supervise` say where the results so far are."""
    try:
        return supervise(ready.services.coupler, ready.services.sides, watcher)
    except GimpmdError as error:
        error.args = (f"{error}\nthe results so far are in {ready.folder}",)
        raise

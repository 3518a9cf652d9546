"""A whole run: from a checked case to the outcome."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from gimpmd_deploy.launch.asking import ask_lammps, needs_lammps
from gimpmd_deploy.launch.asking_continuum import ask_correction
from gimpmd_deploy.launch.folder import check_folder, make_folder, storage_trouble
from gimpmd_deploy.launch.modes import Modes, look_at_modes
from gimpmd_deploy.launch.resume import drop_unfinished
from gimpmd_deploy.launch.services import DEADLINE, RunServices, services_of, with_deadline
from gimpmd_deploy.launch.supervise import Outcome, Watcher, supervise
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.checkpoint.manifest import Manifest, committed
from gimpmd_schemas.errors import GimpmdError, PeerLostError, StorageError
from gimpmd_schemas.resolve import fill_in, resolve
from gimpmd_schemas.run_lock import RunLock
from gimpmd_schemas.wire.answers import CorrectionSize, Probe

RESTARTS = 2
"""How often a run goes on from the same checkpoint before it is given up."""


@dataclass(frozen=True)
class ReadyRun:
    """A run that is ready to start.

    Attributes
    ----------
    case : Case
        As the user wrote it.
    probe : Probe
        What LAMMPS answered; empty if the case does not need LAMMPS.
    correction : CorrectionSize or None
        What GIMP answered, in a run with the sites scheme.
    modes : Modes or None
        The same of the modes of atoms and nodes.
    plan : Plan
    folder : Path
        The run folder, with the case, the plan and the scripts in it.
    services : RunServices
    lock : RunLock
        On the run folder.
    """

    case: Case
    probe: Probe
    correction: CorrectionSize | None
    modes: Modes | None
    plan: Plan
    folder: Path
    services: RunServices
    lock: RunLock


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
        LAMMPS refused a script, the set-up is not stable, a service crashed, or ``mpiexec`` is
        missing.
    StorageError
        The folder cannot be written.
    """
    probe, plan = _make_plan(case, path, folder, force)
    known = fill_in(case, probe, path)
    correction, modes = ask_correction(known, path), look_at_modes(known, path)
    services = services_of(plan, folder)
    lock = make_folder(case, plan, path.parent, folder, force)
    return ReadyRun(case, probe, correction, modes, plan, folder, services, lock)


def make_run_folder(case: Case, path: Path, folder: Path, force: bool) -> tuple[Probe, Plan]:
    """Make the folder of a run that is started by hand; see `make_ready`."""
    probe, plan = _make_plan(case, path, folder, force)
    make_folder(case, plan, path.parent, folder, force).close()
    return probe, plan


def _make_plan(case: Case, path: Path, folder: Path, force: bool) -> tuple[Probe, Plan]:
    check_folder(folder, path.parent, force)
    probe = ask(case, path)
    return probe, resolve(case, probe, path)


def start(
    folder: Path,
    services: RunServices,
    lock: RunLock,
    watcher: Watcher,
    restart: bool = True,
    deadline: float = DEADLINE,
) -> Outcome:
    """Run to the end.

    Parameters
    ----------
    lock : RunLock
        On the run folder; it is closed at the end.
    restart : bool
        Whether the run goes on from its last checkpoint when a process has died, at most `RESTARTS`
        times from the same one.
    deadline : float
        Seconds without a coupling step after which the coupler says whom it waits for.

    Raises
    ------
    BackendError, PeerLostError
        See `supervise`. The message says where the results so far are.
    StorageError
        The disk is full or read-only, or the run folder was deleted.
    """
    deaths: list[int] = []  # after the checkpoints of these steps
    with lock:
        while True:
            try:
                coupler = with_deadline(services.coupler, deadline)
                return supervise(coupler, services.sides, watcher, inherits=[lock.file])
            except GimpmdError as error:
                last = _place_to_go_on(folder, error, deaths, restart)
                watcher.say(
                    f"{error}\ngoing on from the checkpoint at step {last.step}, t = {last.time:g}"
                )
            drop_unfinished(folder, last.step)
            services = services.again()


def _place_to_go_on(folder: Path, error: GimpmdError, deaths: list[int], restart: bool) -> Manifest:
    """Return the checkpoint from which a run goes on after an error, or raise the error.

    Parameters
    ----------
    deaths : list of int
        Steps of the checkpoints after which the run has died before; one is added.
    """
    said = str(error)
    if trouble := storage_trouble(folder, said):
        reason = f"cannot write in the run folder {folder}: {trouble}"
        _conclude(folder, reason)
        raise StorageError(f"{reason}\n{said}") from None
    last = next(iter(committed(folder)), None)
    if last is not None:
        deaths.append(last.step)
    often = deaths.count(deaths[-1]) if deaths else 0
    if last is not None and restart and isinstance(error, PeerLostError) and often <= RESTARTS:
        return last
    _conclude(folder, said)
    why = f"the run has died {often} times after step {deaths[-1]}\n" if often > 1 else ""
    error.args = (f"{said}\n{why}the results so far are in {folder}",)
    raise error


def _conclude(folder: Path, said: str) -> None:
    """Note in ``run.h5`` how the run ended, in case the coupler could not."""
    record = folder / "run.h5"
    if record.is_file():
        outcome = f"failed: {said.splitlines()[0]}"
        subprocess.run(
            [sys.executable, "-m", "gimpmd_coupler.conclude", str(record), outcome],
            stderr=subprocess.DEVNULL,  # readers take the outcome "running" for lost then
            check=False,
        )

"""A replay: one side of a recorded run is played back, and the other one runs."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np

from gimpmd_deploy.launch.by_hand import PATIENCE, meeting_place
from gimpmd_deploy.launch.folder import check_folder, make_folder
from gimpmd_deploy.launch.processes import ENVIRONMENT, Service, mpiexec
from gimpmd_deploy.launch.services import NAMES, RunServices, services_of, with_full_paths
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.case.load import load_case
from gimpmd_schemas.case.plan import Plan, load_plan
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_schemas.run_lock import RunLock, in_use, is_locked
from gimpmd_schemas.wire.recording import RECORDING, Recording, open_recording
from gimpmd_schemas.wire.replay import Replay, write_settings

PLAYER = "gimpmd_coupler.replay"


@dataclass(frozen=True)
class Wanted:
    """What the user asks for.

    Attributes
    ----------
    side : the side that is played back.
    steps : last step, or None: as far as the recording goes.
    tolerance : largest accepted difference, relative to the largest recorded value of the field;
        0: all bits must be the same.
    goes_on : whether to go on after a difference.
    by_hand : whether the user starts the other side.
    command : words that start the other side in place of the service of the case; may be empty.
    """

    side: Role
    steps: int | None = None
    tolerance: float = 0.0
    goes_on: bool = False
    by_hand: bool = False
    command: Sequence[str] = ()

    @property
    def live(self) -> Role:
        """The side that runs."""
        return "md" if self.side == "continuum" else "continuum"


@dataclass(frozen=True)
class ReadyReplay:
    """A replay that is ready to start.

    Attributes
    ----------
    plan : of the replay; it ends with the recording.
    folder : its run folder.
    services : the coupler, the side that is played back, and the other one if the user does not
        start it.
    lock : on the run folder.
    notes : what the user should know about the recording, one sentence each.
    command : lines that start the other side by hand; empty if it is started.
    """

    plan: Plan
    folder: Path
    services: RunServices
    lock: RunLock
    notes: tuple[str, ...]
    command: tuple[str, ...]


@dataclass(frozen=True)
class Survey:
    """What a recording contains.

    Attributes
    ----------
    last : last step that can be replayed.
    largest : largest absolute value of each field of the side that runs.
    failure : why the recorded run failed, or empty.
    """

    last: int
    largest: dict[str, float]
    failure: str


def default_folder(run: Path, side: Role) -> Path:
    """Return ``RUN-replay-SIDE``."""
    return run.with_name(f"{run.resolve().name}-replay-{side}")


def make_ready(run: Path, folder: Path, wanted: Wanted, force: bool) -> ReadyReplay:
    """Read a recording, and make the run folder of its replay.

    Parameters
    ----------
    run : Path
        The folder of the recorded run.
    folder : Path
        The run folder of the replay.
    wanted : Wanted
    force : bool
        Whether an earlier run in the folder may be overwritten.

    Raises
    ------
    InputError
        There is no recording, it cannot be replayed, or the folder cannot be used.
    BackendError
        A side needs MPI, and there is no ``mpiexec``.
    StorageError
        The folder cannot be written.
    """
    recorded = _recorded_plan(run)
    check_folder(folder, run, force)
    with open_recording(run / RECORDING) as recording:
        found = survey(recording, recorded, wanted)
        if len(recording.entries) < sum(map(recorded.ranks, recorded.roles)) or found.last < 1:
            raise _refuse(run, "the run ended before its first step", "there is nothing to replay")
    plan = msgspec.structs.replace(recorded, steps=found.last, record=False)
    case = load_case(run / "case.yaml")
    program = [sys.executable, "-m", PLAYER]
    if (ranks := plan.ranks(wanted.side)) > 1:
        program = [mpiexec(), "-n", str(ranks), *program]
    others: dict[Role, Sequence[str]] = {wanted.side: program}
    if wanted.command:
        others[wanted.live] = with_full_paths(wanted.command)
    services = services_of(plan, folder, others)
    lock = make_folder(case, plan, run / "input", folder, force)
    settings = Replay(
        recording=str((run / RECORDING).absolute()),
        side=wanted.side,
        tolerance={name: wanted.tolerance * most for name, most in found.largest.items()}
        if wanted.tolerance
        else {},
        goes_on=wanted.goes_on,
    )
    write_settings(folder, settings)
    command: tuple[str, ...] = ()
    if wanted.by_hand:
        services, command = _without(services, NAMES[wanted.live], folder)
    return ReadyReplay(plan, folder, services, lock, _notes(found, recorded, plan), command)


def _recorded_plan(run: Path) -> Plan:
    """Plan of a run that was recorded.

    Raises
    ------
    InputError
        There is no such run.
    """
    if not (run / "plan.yaml").is_file():
        raise _refuse(run, "there is no run in this folder", "start one with gimpmd run")
    plan = load_plan(run / "plan.yaml")
    if plan.coupling is None:
        raise _refuse(run, "a run of one side has nothing to replay", "record a coupled run")
    if not (run / RECORDING).is_file():
        hint = "write record: true in the case, and run it again"
        raise _refuse(run, f"the run was not recorded: there is no {RECORDING}", hint)
    if is_locked(run):
        raise in_use(run)
    return plan


def survey(recording: Recording, plan: Plan, wanted: Wanted) -> Survey:
    """Read a recording once to see how far it goes.

    Raises
    ------
    InputError
        It is damaged.
    """
    largest: dict[str, float] = {}
    last, senders = -1, recording.senders(wanted.side)
    for one in recording.steps():
        if last == wanted.steps:
            break
        if not senders <= one.payloads.keys():  # the end of a run that failed; the reason follows
            continue
        last = one.step
        for (role, _), fields in one.payloads.items():
            for name, array in fields.items() if role == wanted.live else ():
                most = float(np.abs(array).max(initial=0.0))
                largest[name] = max(largest.get(name, 0.0), most)
    failed = recording.failure if last != wanted.steps else ""
    if failed and wanted.side == "md":
        last += 1  # the continuum fails beyond the last payload of the atoms
    elif not failed:
        last -= last % plan.steps_together
    return Survey(last, largest, failed)


def _refuse(run: Path, message: str, hint: str) -> InputError:
    return InputError(str(run), [Problem("RUN", None, message, hint)])


def _notes(found: Survey, recorded: Plan, plan: Plan) -> tuple[str, ...]:
    if found.failure:
        return (f"the recorded run failed: {found.failure}",)
    if plan.steps < recorded.steps:
        return (f"the replay ends at step {plan.steps} of {recorded.steps}",)
    return ()


def _without(services: RunServices, name: str, folder: Path) -> tuple[RunServices, tuple[str, ...]]:
    """Leave out a service, and return the lines that start it by hand."""
    endpoint = meeting_place(folder, None)
    coupler = replace(services.coupler, argv=[*services.coupler.argv, "--listen", endpoint])
    left = next(one for one in services.sides(endpoint) if one.name == name)
    settings = " ".join(f"{key}={value}" for key, value in ENVIRONMENT.items())
    lines = (
        f"cd {shlex.quote(str(left.cwd))}",
        f"export {settings}",
        shlex.join([*left.argv, "--patience", f"{PATIENCE:g}"]),
    )

    def rest(where: str) -> Sequence[Service]:
        return [one for one in services.sides(where) if one.name != name]

    return replace(services, coupler=coupler, sides=rest), lines

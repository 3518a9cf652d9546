"""A run folder, opened: what the run was, and everything that it wrote."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np

from gimpmd_deploy.results.atoms import AtomsFile
from gimpmd_deploy.results.energies import RunEnergies
from gimpmd_deploy.results.findings import RunFinding
from gimpmd_deploy.results.particles import Particles
from gimpmd_deploy.results.points import PointsFile
from gimpmd_deploy.results.record import Record
from gimpmd_deploy.results.timings import Timings
from gimpmd_schemas.case.form import Case, Role
from gimpmd_schemas.case.load import load_case
from gimpmd_schemas.case.plan import Plan, load_plan
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_schemas.run_lock import is_locked

T = TypeVar("T")

LOST = "lost: all processes were killed, and the record ends before the run did"
"""Outcome of a run whose record says ``running`` although no process works in its folder."""


class Run:
    """A run folder.

    Parameters
    ----------
    folder : Path
        The folder that ``gimpmd run`` made, for example ``runs/mode1-small``.

    Attributes
    ----------
    case : Case
        The case as the user wrote it.
    plan : Plan
        What ran: the case with every choice made.

    Raises
    ------
    InputError
        The folder holds no run.
    """

    def __init__(self, folder: Path | str) -> None:
        self.folder = Path(folder)
        if not (self.folder / "case.yaml").is_file():
            hint = "give the folder that gimpmd run made, for example runs/mode1-small"
            problem = Problem("case.yaml", None, "is missing: this is not a run folder", hint)
            raise InputError(str(folder), [problem])
        self.case: Case = load_case(self.folder / "case.yaml")
        self.plan: Plan = load_plan(self.folder / "plan.yaml")

    def __repr__(self) -> str:
        return f"Run({str(self.folder)!r})"

    @cached_property
    def record(self) -> Record:
        """Everything in ``run.h5``.

        Raises
        ------
        InputError
            The file is missing or damaged.
        """
        path = self.folder / "run.h5"
        if not path.is_file():
            message, hint = "the run recorded nothing", "the folder logs/ says how far it came"
            raise InputError(str(path), [Problem("file", None, message, hint)])
        return _open(path, lambda: Record.read(path))

    @property
    def energies(self) -> RunEnergies:
        """Mass, momentum and energies over time; see `record` for errors."""
        return self.record.energies

    @property
    def timings(self) -> Timings:
        """Wall time and memory of the processes; see `record` for errors."""
        return self.record.timings

    @property
    def findings(self) -> tuple[RunFinding, ...]:
        """What the monitors found, the first of each kind on each side; empty in a sound run."""
        return self.record.findings

    @property
    def outcome(self) -> str:
        """``completed``, ``stopped``, ``running``, or which process was lost or failed."""
        said = self.record.outcome
        return LOST if said == "running" and not is_locked(self.folder) else said

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know about the results, one sentence each; see `record`."""
        return self.record.notes

    @property
    def seconds(self) -> float | None:
        """Wall time of the run; None while it goes on."""
        return self.record.seconds

    @cached_property
    def points_file(self) -> PointsFile | None:
        """Material points over time; None if the run wrote none."""
        path = self.folder / "fields" / "points.vtkhdf"
        return _open(path, lambda: PointsFile(path)) if path.is_file() else None

    @cached_property
    def atoms_file(self) -> AtomsFile | None:
        """Atoms over time; None if the run wrote none."""
        path = self.folder / "atoms" / "atoms.dump"
        if not path.is_file():
            return None
        return _open(path, lambda: AtomsFile(path, self.plan.atoms.timestep))

    @property
    def times(self) -> list[float]:
        """Times at which each side that wrote output has some.

        Raises
        ------
        InputError
            The run wrote no output.
        """
        files = list(self._files().values())
        if not files:
            hint = "the folder logs/ says how far the run came"
            problem = Problem("fields", None, "the run wrote no output", hint)
            raise InputError(str(self.folder), [problem])
        return [
            time
            for time in files[0].times
            if all(find_time(file.times, time, self._near) is not None for file in files[1:])
        ]

    def points(self, time: float | None = None) -> Particles:
        """Return the material points at an output; ``time`` None is the last one.

        Raises
        ------
        InputError
            There are no material points, or no output within half a coupling step of ``time``.
        """
        return self._output("continuum", "material points", time)

    def atoms(self, time: float | None = None) -> Particles:
        """Return the atoms at an output; ``time`` None is the last one.

        Raises
        ------
        InputError
            There are no atoms, or no output within half a coupling step of ``time``.
        """
        return self._output("md", "atoms", time)

    def particles(self, time: float) -> dict[Role, Particles]:
        """Return what each side wrote at an output; a side that wrote nothing is left out."""
        found: dict[Role, Particles] = {}
        for role, file in self._files().items():
            index = find_time(file.times, time, self._near)
            if index is not None:
                found[role] = file.read(index)
        return found

    @property
    def _near(self) -> float:
        return 0.5 * self.plan.step

    def _files(self) -> dict[Role, PointsFile | AtomsFile]:
        files: dict[Role, PointsFile | AtomsFile | None] = {
            "continuum": self.points_file,
            "md": self.atoms_file,
        }
        return {role: file for role, file in files.items() if file is not None}

    def _output(self, role: Role, name: str, time: float | None) -> Particles:
        file = self._files().get(role)
        if file is None or not file.times:
            problem = Problem(name, None, f"the run wrote no {name}", "see run.plan.roles")
            raise InputError(str(self.folder), [problem])
        index = len(file.times) - 1 if time is None else find_time(file.times, time, self._near)
        if index is None:
            hint = "the run wrote them at t = " + ", ".join(f"{t:.6g}" for t in file.times)
            problem = Problem("time", time, f"the run wrote no {name} at this time", hint)
            raise InputError(str(self.folder), [problem])
        return file.read(index)


def find_time(times: Sequence[float], time: float, near: float) -> int | None:
    """Return the index of the entry nearest to ``time``, if it is nearer than ``near``."""
    if not times:
        return None
    index = int(np.argmin(np.abs(np.asarray(times) - time)))
    return index if abs(times[index] - time) < near else None


def _open(path: Path, opener: Callable[[], T]) -> T:
    try:
        return opener()
    except (OSError, KeyError, ValueError) as error:
        problem = Problem("file", None, f"is damaged: {error}", "run the case again")
        raise InputError(str(path), [problem]) from None

"""The services of a run as commands: the coupler, the MD service and the continuum service."""

from __future__ import annotations

import sys
import uuid
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

from gimpmd_deploy.launch.processes import Service, mpiexec
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.errors import STOPPED, DefectError

NAMES: dict[Role, str] = {"md": "md", "continuum": "gimp"}
"""Name of the service of each role: of its package and of its log."""

COUPLER_CODES = (0, STOPPED, DefectError.exit_code)
"""Exit codes of a coupler that has not failed."""

DEADLINE = 10.0
"""Seconds without a coupling step after which the coupler says whom it waits for."""


@dataclass(frozen=True)
class RunServices:
    """Services of one run.

    Attributes
    ----------
    coupler : Service
        Started first.
    sides : callable
        Takes the endpoint on which the coupler listens; returns the services of the sides.
    again : callable
        Returns the services with which the run goes on after a death.
    """

    coupler: Service
    sides: Callable[[str], Sequence[Service]]
    again: Callable[[], RunServices]


def run_id(plan: Plan) -> str:
    """Return a new id for a run."""
    return f"{plan.name}-{uuid.uuid4().hex[:12]}"


def run_words(folder: Path, run: str) -> list[str]:
    """Words that tell a service to which run it belongs."""
    return ["--run-dir", str(folder.absolute()), "--run", run]


def rank_words(role: Role, folder: Path, run: str, endpoint: str) -> list[str]:
    """Words after the program of a side."""
    command = ["serve"] if role == "md" else []
    return [*command, *run_words(folder, run), "--connect", endpoint]


def foreign_program(plan: Plan, name: str) -> tuple[str, ...]:
    """Return the program that the case names for a service; empty: that of gimpmd."""
    return plan.continuum.command if name == NAMES["continuum"] else ()


def with_full_paths(words: Sequence[str]) -> list[str]:
    """Full paths of the words that name files here: a service starts in its run folder."""
    return [str(Path(word).absolute()) if Path(word).is_file() else word for word in words]


def services_of(
    plan: Plan, folder: Path, others: Mapping[Role, Sequence[str]] = MappingProxyType({})
) -> RunServices:
    """Return the services that run a plan in a run folder.

    Parameters
    ----------
    others : mapping, optional
        Words that start a side in another way than the plan says, up to the arguments of a service.

    Raises
    ------
    BackendError
        A service needs MPI, and there is no ``mpiexec``.
    """
    folder, run = folder.absolute(), run_id(plan)
    launchers = {role: _launcher(plan, role) for role in plan.roles}

    def service(name: str, launcher: list[str], words: list[str], directory: Path) -> Service:
        own = [sys.executable, "-m", f"gimpmd_{name}.service"]
        command = [*launcher, *(foreign_program(plan, name) or own), *words]
        return Service(name, command, folder / "logs" / f"{name}.log", directory)

    def side(role: Role, endpoint: str) -> Service:
        place = folder / "input" if role == "md" else folder
        words = rank_words(role, folder, run, endpoint)
        found = service(NAMES[role], launchers[role], words, place)
        if role in others:
            words = [*run_words(folder, run), "--connect", endpoint]
            found = replace(found, argv=[*others[role], *words])
        return found

    def sides(endpoint: str) -> list[Service]:
        return [side(role, endpoint) for role in plan.roles]

    coupler = service("coupler", [], [*run_words(folder, run), "--supervised"], folder)
    return RunServices(
        replace(coupler, good_codes=COUPLER_CODES),
        sides,
        again=lambda: services_of(plan, folder, others),  # with a new run id
    )


def with_deadline(coupler: Service, deadline: float) -> Service:
    """The coupler with another deadline (seconds); `math.inf`: it waits as long as all live."""
    return replace(coupler, argv=[*coupler.argv, "--deadline", repr(deadline)])


def _launcher(plan: Plan, role: Role) -> list[str]:
    """Words that start a service on its MPI ranks; LAMMPS always runs under MPI."""
    ranks = plan.ranks(role)
    return [mpiexec(), "-n", str(ranks)] if role == "md" or ranks > 1 else []

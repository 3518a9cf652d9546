"""The bodies of a check: a strip with both sides, and a free body of one side."""

from __future__ import annotations

from pathlib import Path

import msgspec

from gimpmd_deploy.launch.folder import copy_input
from gimpmd_deploy.launch.reading import check
from gimpmd_deploy.launch.run import ask
from gimpmd_schemas.case.form import Case, Role
from gimpmd_schemas.case.load import load_case
from gimpmd_schemas.case.plan import Plan, write_plan
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_schemas.resolve import resolve
from gimpmd_schemas.wire.answers import Probe

INPUTS = Path(__file__).parent / "inputs"
STRIP, BLOCK = INPUTS / "strip.yaml", INPUTS / "block.yaml"
"""The cases that come with gimpmd; their atoms are for LAMMPS."""


def prepare(path: Path, side: Role, backend: str | None, only: bool, folder: Path) -> Plan:
    """Write the plan of a case, and copies of the scripts of its MD code, into a folder.

    Parameters
    ----------
    path : Path
        The case file.
    side : Role
        The side that is checked.
    backend : str, optional
        Replaces that of this side.
    only : bool
        Whether the side runs alone.
    folder : Path
        Must not exist.

    Returns
    -------
    Plan

    Raises
    ------
    InputError
        The case cannot run, or is no case for a check.
    BackendError, PeerLostError
        LAMMPS refused a script, or the MD service crashed.
    """
    case = _chosen(load_case(path), side, backend, only)
    _check_form(case, path)
    (folder / "input").mkdir(parents=True)
    if side == "continuum" and path.parent == INPUTS:  # nothing is left to measure
        coupling = case.coupling
        probe = Probe(crystal=coupling.crystal, planes=coupling.planes)
    else:
        check(case, path)
        probe = ask(case, path)
        copy_input(case, path.parent, folder / "input")
    plan = resolve(case, probe, path)
    write_plan(plan, folder / "plan.yaml")
    return plan


def _chosen(case: Case, side: Role, backend: str | None, only: bool) -> Case:
    """The case on one rank for each side, with the backend."""
    replace = msgspec.structs.replace
    continuum = replace(case.continuum, ranks=1, patches="auto", threads=1)
    md = case.md and replace(case.md, ranks=1, patches="auto")
    if backend is not None and side == "continuum":
        continuum = replace(continuum, backend=backend)
    if backend is not None and side == "md" and md is not None:
        md = replace(md, backend=backend)
    return replace(case, continuum=continuum, md=md, only=side if only else None)


def _check_form(case: Case, path: Path) -> None:
    """The check plays the other side of the force scheme, on one level.

    Raises
    ------
    InputError
        The case has another scheme, or levels.
    """
    problems = []
    if case.only is None and case.coupling.scheme != "force":
        hint = "write force: the check plays the other side of this scheme"
        problems.append(Problem("coupling.scheme", case.coupling.scheme, "is not checked", hint))
    if case.grid.levels:
        problems.append(Problem("grid.levels", None, "is not checked", "leave the levels out"))
    if problems:
        raise InputError(str(path), problems)

"""Reading a case: the user's choices applied, and everything checked that needs no LAMMPS."""

from __future__ import annotations

from pathlib import Path, PurePath
from typing import Literal

import msgspec

from gimpmd_schemas.case.checks.check import check_case
from gimpmd_schemas.case.derive.scripts import input_files
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import load_case
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_schemas.registry import check_code


def read_case(
    path: Path,
    only: Literal["md", "continuum"] | None = None,
    ranks_md: int | None = None,
    ranks_gimp: int | None = None,
    until: float | None = None,
) -> Case:
    """Read a case file, apply the user's choices, and check all that can be checked without LAMMPS.

    Parameters
    ----------
    path : Path
    only, ranks_md, ranks_gimp, until
        Replace ``only``, ``md.ranks``, ``continuum.ranks`` and ``time.end`` of the case.

    Raises
    ------
    InputError
        Lists every problem.
    """
    case = choose(load_case(path), only, ranks_md, ranks_gimp, until)
    check(case, path)
    return case


def choose(
    case: Case,
    only: Literal["md", "continuum"] | None,
    ranks_md: int | None,
    ranks_gimp: int | None,
    until: float | None = None,
) -> Case:
    """Return a case with the user's choices; what is None stays."""
    md, continuum, time = case.md, case.continuum, case.time
    if ranks_md is not None and md is not None:
        md = msgspec.structs.replace(md, ranks=ranks_md)
    if ranks_gimp is not None:
        continuum = msgspec.structs.replace(continuum, ranks=ranks_gimp)
    if until is not None:
        time = msgspec.structs.replace(time, end=until)
    return msgspec.structs.replace(
        case, only=only or case.only, md=md, continuum=continuum, time=time
    )


def check(case: Case, path: Path) -> None:
    """Check the meaning of a case, the files beside it, and that its codes are installed.

    Parameters
    ----------
    path : Path
        The case file, for its folder and for messages.

    Raises
    ------
    InputError
        Lists every problem.
    """
    problems = check_case(case, path.parent) + _check_paths(case) + _check_codes(case)
    if problems:
        raise InputError(str(path), problems)


def _check_paths(case: Case) -> list[Problem]:
    """Files are copied under their own names, which must stay inside the run folder."""
    problems = []
    for key, name in input_files(case):
        if PurePath(name).is_absolute() or ".." in PurePath(name).parts:
            hint = "copy it there and give only its name"
            problems.append(Problem(key, name, "lies outside the case's folder", hint))
    return problems


def _check_codes(case: Case) -> list[Problem]:
    """The code of each side that takes part must be installed."""
    sides = {"md": case.md, "continuum": case.continuum}
    return [
        problem
        for role in case.roles()
        if (side := sides[role]) is not None and (problem := check_code(role, side.backend))
    ]

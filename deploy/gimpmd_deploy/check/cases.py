"""The bodies of a check: one with both sides, and a free one of one side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import msgspec

from gimpmd_deploy.launch.folder import copy_input
from gimpmd_deploy.launch.reading import check
from gimpmd_deploy.launch.run import ask
from gimpmd_schemas.case.checks.check import check_case
from gimpmd_schemas.case.form import AT_PLANES, Case, Role
from gimpmd_schemas.case.load import load_case
from gimpmd_schemas.case.materials import MeasuredByMd
from gimpmd_schemas.case.plan import Plan, write_plan
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_schemas.resolve import resolve
from gimpmd_schemas.wire.access import ROLES
from gimpmd_schemas.wire.answers import Probe

INPUTS = Path(__file__).parent / "inputs"
STRIP, BLOCK = INPUTS / "strip.yaml", INPUTS / "block.yaml"
"""The cases of the body ``strip``; their atoms are for LAMMPS."""

BODIES: Mapping[str, tuple[Path, Path]] = MappingProxyType(
    {
        "strip": (STRIP, BLOCK),
        "levels": (INPUTS / "levels.yaml", INPUTS / "levels-block.yaml"),
        "space": (INPUTS / "space.yaml", INPUTS / "space-block.yaml"),
    }
)
"""The cases that come with gimpmd by the name of their body: a coupled one, and a free one."""


@dataclass(frozen=True)
class Checkup:
    """What is checked.

    Attributes
    ----------
    side : the side.
    backend : code of this side, in place of that of the case, or None.
    ranks : of the service.
    peers : ranks of the other side, which the check plays.
    """

    side: Role
    backend: str | None = None
    ranks: int = 1
    peers: int = 1


def prepare(path: Path, checkup: Checkup, only: bool, folder: Path) -> Plan:
    """Write the plan of a case, and copies of the scripts of its MD code, into a folder.

    Parameters
    ----------
    path : Path
        The case file.
    checkup : Checkup
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
    case = _chosen(load_case(path), checkup, only)
    _check_form(case, path)
    (folder / "input").mkdir(parents=True)
    if checkup.side == "continuum" and path.parent == INPUTS and _is_measured(case):
        if problems := check_case(case, path.parent):  # its atoms need not be installed
            raise InputError(str(path), problems)
        probe = Probe(crystal=case.coupling.crystal, planes=case.coupling.planes)
    else:
        check(case, path)
        probe = ask(case, path)
        copy_input(case, path.parent, folder / "input")
    plan = resolve(case, probe, path)
    write_plan(plan, folder / "plan.yaml")
    return plan


def _chosen(case: Case, checkup: Checkup, only: bool) -> Case:
    """The case with the ranks of the check, and with the backend."""
    replace = msgspec.structs.replace
    side, backend = checkup.side, checkup.backend
    ranks = {role: checkup.ranks if role == side else checkup.peers for role in ROLES}
    continuum = replace(case.continuum, ranks=ranks["continuum"], patches="auto", threads=1)
    md = case.md and replace(case.md, ranks=ranks["md"], patches="auto")
    if backend is not None and side == "continuum":
        continuum = replace(continuum, backend=backend)
    if backend is not None and side == "md" and md is not None:
        md = replace(md, backend=backend)
    return replace(case, continuum=continuum, md=md, only=side if only else None)


def _is_measured(case: Case) -> bool:
    """Whether a continuum needs nothing more that only LAMMPS knows."""
    planes = case.only is not None or case.coupling.planes is not None
    return planes and not isinstance(case.continuum.material, MeasuredByMd)


def _check_form(case: Case, path: Path) -> None:
    """The check plays the other side of the schemes with planes.

    Raises
    ------
    InputError
        The case has another scheme.
    """
    scheme = case.coupling.scheme
    if case.only is None and scheme not in AT_PLANES:
        hint = f"write {' or '.join(AT_PLANES)}: the check plays the other side of these"
        raise InputError(str(path), [Problem("coupling.scheme", scheme, "is not checked", hint)])

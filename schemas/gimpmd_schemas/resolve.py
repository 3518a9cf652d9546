"""From a case and what LAMMPS has measured to a plan."""

from __future__ import annotations

from pathlib import Path

import msgspec

from gimpmd_schemas.case.checks.check import check_case
from gimpmd_schemas.case.derive.choices import is_coupled_at_planes
from gimpmd_schemas.case.derive.program import with_program
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.materials import (
    EmbeddedLattice,
    Hyperelastic,
    MeasuredByMd,
    PairLattice,
)
from gimpmd_schemas.case.plan import Plan, make_plan
from gimpmd_schemas.errors import InputError, PeerLostError, Problem
from gimpmd_schemas.wire.answers import Probe


def resolve(case: Case, probe: Probe, path: Path) -> Plan:
    """Make the plan of a case.

    Parameters
    ----------
    case : Case
        Its form and its meaning have been checked.
    probe : Probe
        What LAMMPS has measured; ``Probe()`` for a case that does not need LAMMPS.
    path : Path
        The case file, for messages.

    Raises
    ------
    InputError
        The case does not fit what LAMMPS has measured: another cutoff, zones narrower than the
        cutoff, or a time step that is too long for the lattice.
    PeerLostError
        The MD service has not measured what the case needs.
    """
    measured = fill_in(case, probe, path)
    problems = _check_cutoff(case, probe) + check_case(measured, spacing=probe.spacing)
    if problems:
        raise InputError(str(path), problems)
    return make_plan(with_program(measured, path.parent))


def fill_in(case: Case, probe: Probe, path: Path) -> Case:
    """Put what LAMMPS has measured into the case: cutoff, material, crystal and planes.

    Raises
    ------
    PeerLostError
        The MD service has not measured what the case needs.
    """
    replace = msgspec.structs.replace
    if probe.cutoff is not None:
        case = replace(case, md=replace(case.atoms, cutoff=probe.cutoff))
    asked = case.continuum.material
    if isinstance(asked, MeasuredByMd):
        is_crystal = isinstance(probe.material, Hyperelastic | PairLattice | EmbeddedLattice)
        if probe.material is None or is_crystal != (asked.model != "linear"):
            raise PeerLostError(f"{path}: the MD service measured no {asked.model} material")
        case = replace(case, continuum=replace(case.continuum, material=probe.material))
    if is_coupled_at_planes(case):
        found = probe.crystal if case.coupling.scheme == "force" else probe.sites
        if found is None or probe.planes is None:
            raise PeerLostError(f"{path}: the MD service found no crystal and no planes")
        coupling = replace(
            case.coupling, crystal=probe.crystal, planes=probe.planes, sites=probe.sites
        )
        case = replace(case, coupling=coupling)
    return case


def _check_cutoff(case: Case, probe: Probe) -> list[Problem]:
    """A cutoff in the case must be the one of LAMMPS."""
    given, measured = case.md.cutoff if case.md else None, probe.cutoff
    if given is None or measured is None or abs(given - measured) <= 1e-6 * measured:
        return []
    message = f"is not LAMMPS's own, which is {measured:g}"
    return [Problem("md.cutoff", given, message, f"write {measured:g}, or leave the key out")]

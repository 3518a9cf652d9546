"""A case completed: what LAMMPS measured is filled in, and checked."""

from __future__ import annotations

from pathlib import Path

import msgspec

from gimpmd_schemas.case.checks.check import check_case, check_stability
from gimpmd_schemas.case.form import Case, Hyperelastic, MeasuredByMd, PairLattice
from gimpmd_schemas.errors import InputError, PeerLostError, Problem
from gimpmd_schemas.wire.answers import Probe


def measured(case: Case, probe: Probe, path: Path) -> Case:
    """Fill in what LAMMPS measured, and check what needs it.

    Parameters
    ----------
    case : Case
        Checked.
    probe : Probe
        LAMMPS's answer.
    path : Path
        The case file, for messages.

    Raises
    ------
    InputError
        Zones are narrower than the cutoff, or a time step is too long for the lattice.
    PeerLostError
        The answer lacks what the case needs.
    """
    problems = []
    cutoff = probe.cutoff
    if cutoff is not None:
        given = case.atoms.cutoff
        if given is not None and abs(given - cutoff) > 1e-6 * cutoff:
            hint = f"write {cutoff:g}, or leave the key out"
            message = f"differs from the cutoff in LAMMPS, which is {cutoff:g}"
            problems.append(Problem("md.cutoff", given, message, hint))
        case = msgspec.structs.replace(case, md=msgspec.structs.replace(case.atoms, cutoff=cutoff))
    if isinstance(case.continuum.material, MeasuredByMd):
        model = case.continuum.material.model
        crystal = isinstance(probe.material, Hyperelastic | PairLattice)
        if probe.material is None or crystal != (model == "cauchy-born"):
            raise PeerLostError(f"{path}: the MD service did not measure a {model} material")
        continuum = msgspec.structs.replace(case.continuum, material=probe.material)
        case = msgspec.structs.replace(case, continuum=continuum)
    if case.only is None and case.coupling.scheme == "force":
        if probe.crystal is None or probe.planes is None:
            raise PeerLostError(f"{path}: the MD service did not find a crystal and planes")
        coupling = msgspec.structs.replace(
            case.coupling, crystal=probe.crystal, planes=probe.planes
        )
        case = msgspec.structs.replace(case, coupling=coupling)
    problems += check_case(case)
    if not problems:
        problems += check_stability(case, probe.spacing)
    if problems:
        raise InputError(str(path), problems)
    return case

"""What the atoms of a case are, found by making them once before the run."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from gimpmd_md.coupling.cutoff import check_cutoff
from gimpmd_md.crystal import bonds, bravais, embedded, find, find_sites, moduli, vibrations
from gimpmd_md.crystal.cauchy_born import energy_in_space, strain_energy
from gimpmd_md.crystal.cell import Cell, open_cell
from gimpmd_md.engines.lammps.notes import notes_on
from gimpmd_md.engines.lammps.script import Script, build, cutoff_of, rehearse
from gimpmd_md.sums import spacing_of
from gimpmd_schemas.case.derive.zones import zones
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.materials import (
    DEGREE,
    Anisotropic,
    Elastic,
    EmbeddedLattice,
    Hyperelastic,
    Material,
    MeasuredByMd,
    PairLattice,
)
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.registry import load_code
from gimpmd_schemas.wire.answers import Probe

InSpace = Anisotropic | Hyperelastic | EmbeddedLattice
"""Materials that LAMMPS measures in three dimensions."""

LAMMPS = "lammps"
"""The MD code that can measure materials and find crystals."""


def measure(
    material: MeasuredByMd, units: str, dim: int, comm: Any, log: Path, *, warm: bool = False
) -> Material:
    """Moduli of the crystal in a periodic cell and, if asked for, its energy at finite strains.

    In three dimensions these are all elastic constants, for a crystal of any symmetry, the energy
    with these constants at rest, and the thermal stress if it is ``warm``. In two, for a pair
    potential and one atom in the primitive cell all follows from the bonds.

    Raises
    ------
    BackendError
        LAMMPS refuses the script, or the crystal is not suitable.
    """
    with open_cell(material.cell, units, comm, log, dims=(dim,)) as cell:
        if dim == 3:
            found = _in_space(material, cell)
            return with_thermal_stress(found, cell) if warm else found
        return _in_plane(material, cell)


def _in_plane(material: MeasuredByMd, cell: Cell) -> Elastic | Hyperelastic | PairLattice:
    lattice = bonds.of_cell(cell)
    found = None if lattice is None else bonds.stable(cell, *lattice)
    if lattice is None or found is None:
        elastic = moduli.measure(cell)
        return elastic if material.model == "linear" else _tabulated(elastic, cell)
    elastic = moduli.of_bonds(cell, lattice[0], found)
    if material.model == "linear":
        return elastic
    return PairLattice(
        density=elastic.density,
        lame=elastic.lame,
        shear=elastic.shear,
        area=bravais.area(lattice[0]),
        bonds=find.pairs(found.vectors),
        energy=tuple(tuple(c.tolist()) for c in found.energy),
        stretch_limit=found.stretch_limit,
    )


def _in_space(material: MeasuredByMd, cell: Cell) -> InSpace:
    linear = moduli.measure_all(cell)
    if material.model == "linear":
        return linear
    if material.model == "lattice-sum":
        return embedded.of_cell(cell, linear)
    coefficients, limit = energy_in_space(
        cell, np.array(linear.stiffness), material.degree or DEGREE, material.strain_limit
    )
    return Hyperelastic(
        density=linear.density, coefficients=tuple(coefficients.tolist()), strain_limit=limit
    )


def with_thermal_stress(material: InSpace, cell: Cell) -> InSpace:
    """The material of a cell with what its vibrations add."""
    stress = tuple(vibrations.thermal_stress(cell).tolist())
    return msgspec.structs.replace(material, thermal_stress=stress)


def _tabulated(elastic: Elastic, cell: Cell) -> Hyperelastic:
    coefficients, limit = strain_energy(cell)
    return Hyperelastic(
        density=elastic.density,
        lame=elastic.lame,
        shear=elastic.shear,
        coefficients=tuple(coefficients.tolist()),
        strain_limit=limit,
    )


def probe(case: Case, comm: Any) -> Probe:
    """Make the atoms of a case in the working directory, and measure its material.

    Parameters
    ----------
    case : Case
        Its scripts are in the working directory.
    comm : mpi4py communicator
        Of one rank.

    Returns
    -------
    Probe

    Raises
    ------
    BackendError
        The MD code is not installed, it refuses a script, or the atoms do not fit the case.
    """
    with tempfile.TemporaryDirectory() as folder:
        if case.only != "continuum" and case.atoms.backend != LAMMPS:
            return _ask_code(case, comm, Path(folder))
        return _ask_lammps(case, comm, Path(folder) / "log.lammps")


def _ask_lammps(case: Case, comm: Any, log: Path) -> Probe:
    """Everything that a case may leave open."""
    material, measured = case.continuum.material, None
    if isinstance(material, MeasuredByMd):
        warm = case.continuum.temperature is not None
        material = measured = measure(material, case.units, case.dim, comm, log, warm=warm)
    if case.only == "continuum":
        return Probe(material=measured)
    script = Script.of_case(case)
    engine = build(script, comm, log)
    cutoff = cutoff_of(script, engine)
    crystal, planes, sites = None, None, None
    if case.only is None:
        scheme, outer = case.coupling.scheme, zones(case).outer
        check_cutoff(script.path, cutoff, engine.is_pairwise(), scheme, outer)
        if scheme == "force":
            crystal, planes = find.find(case, engine, cutoff)
    mass, atoms = engine.evaluate("mass(all)"), int(engine.lammps.get_natoms())
    notes = notes_on(script.path, case.units, engine, cutoff)
    if case.only is None and case.coupling.scheme == "sites":
        found = find_sites.atoms_of(script.path, engine, cutoff, log.parent)
        planes, sites = find_sites.find(case, found, comm, log.parent)
    if case.atoms.after is not None:
        rehearse(case.atoms.after, engine)
    engine.close()
    return Probe(
        atoms=atoms,
        mass=mass,
        cutoff=cutoff,
        spacing=spacing_of(mass, atoms, material.density, case.dim),
        material=measured,
        crystal=crystal,
        planes=planes,
        sites=sites,
        notes=notes,
    )


def _ask_code(case: Case, comm: Any, run_dir: Path) -> Probe:
    """Number, mass and range of the atoms of any MD code.

    Raises
    ------
    BackendError
        The case leaves something open that only LAMMPS can measure.
    """
    make_atoms = load_code("md", case.atoms.backend)
    crystal, planes = case.coupling.crystal, case.coupling.planes
    if isinstance(case.continuum.material, MeasuredByMd):
        raise BackendError(
            "continuum.material: only LAMMPS measures a material; with "
            f"md.backend: {case.atoms.backend} give its numbers in the case"
        )
    if case.only is None and case.coupling.scheme == "force" and None in (crystal, planes):
        raise BackendError(
            "coupling.crystal, coupling.planes: only LAMMPS finds them; with "
            f"md.backend: {case.atoms.backend} give them in the case"
        )
    one_rank = msgspec.structs.replace(case.atoms, ranks=1, patches="auto")
    plan = make_plan(msgspec.structs.replace(case, md=one_rank))
    atoms = make_atoms(plan, comm, run_dir)
    mass, count = float(atoms.mass.sum()), len(atoms.mass)
    answer = Probe(
        atoms=count,
        mass=mass,
        cutoff=atoms.cutoff,
        spacing=spacing_of(mass, count, plan.continuum.material.density, plan.dim),
        crystal=crystal,
        planes=planes,
        notes=atoms.notes,
    )
    atoms.close()
    return answer

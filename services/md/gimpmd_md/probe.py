"""What only LAMMPS knows about a case; the atoms are built once before the run to find out."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from gimpmd_md.crystal import bonds, bravais, find, moduli
from gimpmd_md.crystal.cauchy_born import strain_energy
from gimpmd_md.crystal.cell import Cell, open_cell
from gimpmd_md.engines.lammps.script import build, check_cutoff
from gimpmd_schemas.case.form import (
    Case,
    Elastic,
    Hyperelastic,
    Material,
    MeasuredByMd,
    PairLattice,
)
from gimpmd_schemas.wire.answers import Probe


def measure(material: MeasuredByMd, units: str, comm: Any, log: Path) -> Material:
    """Measure the moduli of a crystal and, if the case asks for it, its energy at finite strains.

    Both follow from the bonds if the crystal has one atom in its primitive cell and a pair
    potential. Otherwise a periodic cell is strained.

    Raises
    ------
    BackendError
        LAMMPS refuses the script, or the crystal is not suitable.
    """
    with open_cell(material.cell, units, comm, log) as cell:
        lattice = bonds.of_cell(cell)
        found = None if lattice is None else bonds.stable(cell, *lattice)
        if lattice is None or found is None:
            elastic = moduli.measure(cell)
        else:
            elastic = moduli.of_bonds(cell, lattice[0], found)
        if material.model == "linear":
            return elastic
        if lattice is None or found is None:
            return _tabulated(elastic, cell)
    return PairLattice(
        density=elastic.density,
        lame=elastic.lame,
        shear=elastic.shear,
        area=bravais.area(lattice[0]),
        bonds=find.pairs(found.vectors),
        energy=tuple(tuple(c.tolist()) for c in found.energy),
        stretch_limit=found.stretch_limit,
    )


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
    """Build the atoms of a case in the working directory, and measure its material.

    Parameters
    ----------
    case : Case
        Its scripts are in the working directory.
    comm : mpi4py communicator
        Of one rank.

    Raises
    ------
    BackendError
        LAMMPS refuses a script, or the atoms do not fit the case.
    """
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log.lammps"
        given, measured = case.continuum.material, None
        if isinstance(given, MeasuredByMd):
            material = measured = measure(given, case.units, comm, log)
        else:
            material = given
        if case.only == "continuum":
            return Probe(material=measured)
        engine = build(case, comm, log)
        cutoff = engine.pair_cutoff()
        check_cutoff(case, cutoff, engine.is_pairwise())
        crystal, planes = None, None
        if case.only is None and case.coupling.scheme == "force":
            crystal, planes = find.find(case, engine, cutoff)
        mass, atoms = engine.evaluate("mass(all)"), int(engine.lammps.get_natoms())
        engine.close()
    return Probe(
        atoms=atoms,
        mass=mass,
        cutoff=cutoff,
        spacing=(mass / atoms / material.density) ** (1.0 / case.dim),
        material=measured,
        crystal=crystal,
        planes=planes,
    )

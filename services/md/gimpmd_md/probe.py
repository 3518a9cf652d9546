"""What a case's atoms are, found by building them once before the run."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import msgspec

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


def measure(material: MeasuredByMd, units: str, comm: Any, log: Path) -> Material:
    """Moduli of the crystal in a periodic cell and, if asked for, its energy at finite strains.

    Of a crystal of one atom per primitive cell that is bound in pairs both follow from its bonds.

    Raises
    ------
    BackendError
        LAMMPS refuses the script, or the crystal does not suit.
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


def probe(case: Case, comm: Any) -> dict[str, Any]:
    """Build the atoms of a case in the working directory, and measure its material.

    Parameters
    ----------
    case : Case
        Its scripts lie in the working directory.
    comm : mpi4py communicator
        Of one rank.

    Returns
    -------
    dict
        ``atoms`` (number), ``mass`` (total), ``cutoff`` and ``spacing`` (length units; the
        spacing is ``sqrt(area per atom)`` of the bulk), ``material`` (as the case file would
        give it, when LAMMPS measured it, else None), ``crystal`` and ``planes`` (likewise, in a
        coupled case of the force scheme, else None).

    Raises
    ------
    BackendError
        LAMMPS refuses a script, or the atoms do not fit the case.
    """
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log.lammps"
        material = case.continuum.material
        measured = isinstance(material, MeasuredByMd)
        if isinstance(material, MeasuredByMd):
            material = measure(material, case.units, comm, log)
        if case.only == "continuum":
            return {"material": msgspec.to_builtins(material) if measured else None}
        engine = build(case, comm, log)
        cutoff = engine.pair_cutoff()
        check_cutoff(case, cutoff, engine.is_pairwise())
        found = None
        if case.only is None and case.coupling.scheme == "force":
            found = find.find(case, engine, cutoff)
        mass, atoms = engine.evaluate("mass(all)"), int(engine.lammps.get_natoms())
        engine.close()
    return {
        "atoms": atoms,
        "mass": mass,
        "cutoff": cutoff,
        "spacing": (mass / atoms / material.density) ** 0.5,
        "material": msgspec.to_builtins(material) if measured else None,
        "crystal": msgspec.to_builtins(found[0]) if found else None,
        "planes": msgspec.to_builtins(found[1]) if found else None,
    }

"""Crystals with potentials that LAMMPS brings along, in periodic boxes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from gimpmd_md.crystal.cell import Cell, cell_of
from gimpmd_md.engines.lammps.library import Engine
from gimpmd_md.engines.lammps.site_off.commands import Potential
from gimpmd_md.engines.lammps.site_off.double import with_off_sites


class Sample(NamedTuple):
    """A crystal and its potential: LAMMPS's lattice, its size, and the pair commands."""

    lattice: str
    repeat: tuple[int, int, int]
    style: str
    coeff: str
    dimension: int = 3
    units: str = "metal"


SAMPLES = {
    "hexagonal LJ": Sample("hex 0.9317984", (14, 4, 1), "lj/cut 2.5", "1 1 1.0 1.0", 2, "lj"),
    "Cu eam": Sample("fcc 3.615", (8, 3, 3), "eam", "1 1 Cu_u3.eam"),
    "Cu eam/alloy": Sample("fcc 3.61493", (8, 3, 3), "eam/alloy", "* * Cu_mishin1.eam.alloy Cu"),
    "Al eam/alloy": Sample("fcc 4.05", (8, 3, 3), "eam/alloy", "* * NiAlH_jea.eam.alloy Al"),
    "Al eam/fs": Sample("fcc 4.045", (8, 3, 3), "eam/fs", "* * Al_mm.eam.fs Al"),
    "Fe eam/fs": Sample("bcc 2.8553", (8, 4, 4), "eam/fs", "* * Fe_mm.eam.fs Fe"),
    "W eam/alloy": Sample("bcc 3.165", (9, 4, 4), "eam/alloy", "* * W_zhou.eam.alloy W"),
    "Si sw": Sample("diamond 5.431", (5, 2, 2), "sw", "* * Si.sw Si"),
    "Si tersoff": Sample("diamond 5.432", (5, 2, 2), "tersoff", "* * Si.tersoff Si"),
    "Cu snap": Sample(
        "fcc 3.6338",
        (6, 2, 2),
        "snap",
        "* * Cu_Zuo_JPCA2020.snapcoeff Cu_Zuo_JPCA2020.snapparam Cu",
    ),
}


def potential_of(sample: Sample) -> Potential:
    """The pair commands of a sample."""
    return Potential(tuple(sample.style.split()), (tuple(sample.coeff.split()),))


@contextmanager
def crystal(sample: Sample, folder: Path) -> Iterator[Cell]:
    """A periodic crystal with types for sites that are on (1) and off (2), all of them on."""
    engine = Engine(MPI.COMM_SELF, folder / "log.lammps")
    nx, ny, nz = sample.repeat
    low, high = (0, nz) if sample.dimension == 3 else (-0.5, 0.5)
    doubled = with_off_sites(potential_of(sample), 1, folder)
    try:
        engine.commands(
            [
                f"units {sample.units}",
                f"dimension {sample.dimension}",
                "boundary p p p",
                "atom_style atomic",
                f"lattice {sample.lattice}",
                f"region cell block 0 {nx} 0 {ny} {low} {high}",
                "create_box 2 cell",
                "create_atoms 1 region cell",
                "mass * 1.0",
                *doubled.commands(),
                "mass * 1.0",
            ]
        )
        yield cell_of("sample", engine)
    finally:
        engine.close()


def near_one_end(cell: Cell, part: float) -> np.ndarray:
    """Ids of the atoms in the first part of the length of a cell."""
    x = cell.engine.vectors("x")[:, 0] - cell.low[0]
    return cell.engine.atoms("id")[x < (part - 1e-6) * cell.box[0, 0]].copy()

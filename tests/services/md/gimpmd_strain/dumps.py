"""Dumps that LAMMPS writes, and a reader of them that is none of ours."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mpi4py import MPI

WARM = """create_box 2 box
create_atoms 1 region box
mass * 1
set type 1 type/fraction 2 0.3 5
mass 2 1.5
pair_style lj/cut 2.5
pair_coeff * * 1 1
velocity all create {temperature} 123
fix 1 all nve
{flat}timestep 0.002
{{more}}
dump 1 all custom 50 {{name}} {{columns}}
dump_modify 1 format float %.17g
run 150
"""

STRIP = """units lj
dimension 2
boundary {boundary}
atom_style atomic
lattice hex 0.9317984
region box block 0 12 0 6 -0.5 0.5
""" + WARM.format(temperature=0.02, flat="fix 2 all enforce2d\n")

BLOCK = """units lj
boundary {boundary}
atom_style atomic
lattice fcc 1.0
region box block 0 6 0 4 0 5
""" + WARM.format(temperature=0.05, flat="")


def lammps_runs(script: str) -> None:
    """Run a LAMMPS script in the working directory."""
    from lammps import lammps

    arguments = ["-screen", "none", "-log", "none", "-nocite"]
    instance = lammps(cmdargs=arguments, comm=MPI.COMM_SELF)
    instance.commands_string(script)
    instance.close()


def table(path: Path, columns: str) -> list[tuple[int, np.ndarray]]:
    """Step and named columns of every frame, by ascending id; reads with numpy alone."""
    found = []
    lines = path.read_text().splitlines()
    starts = [i for i, line in enumerate(lines) if line == "ITEM: TIMESTEP"]
    for start, end in zip(starts, [*starts[1:], len(lines)], strict=True):
        head = next(i for i in range(start, end) if lines[i].startswith("ITEM: ATOMS"))
        names = lines[head].split()[2:]
        data = np.array([line.split() for line in lines[head + 1 : end]])
        data = data[np.argsort(data[:, names.index("id")].astype(int))]
        values = data[:, [names.index(name) for name in columns.split()]].astype(float)
        found.append((int(lines[start + 1]), values))
    return found

"""MPI program: load and stir the box of copper, and save its atoms and energies.

``mpiexec -n R python drive_copper.py PATCHES_X PATCHES_Y PATCHES_Z OUTPUT``
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from mpi4py import MPI

from gimpmd_md.side import open_side
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.wire.energies import components
from tests.services.md.copper import LOADS, A, copper_case
from tests.services.md.driving import advance_by


def main() -> None:
    patches, out = [int(count) for count in sys.argv[1:4]], Path(sys.argv[4])
    comm = MPI.COMM_WORLD
    parallel = {"md.ranks": comm.size, "md.patches": patches, "md.variables": {"edge_y": "p"}}
    along_y = {"domain.periodic": [False, True, False]}
    plan = make_plan(copper_case(LOADS | parallel | along_y))
    side = open_side(plan, comm, out.with_suffix(""))
    side.finish()
    side.atoms.v[:] = 5.0 * np.sin(2.0 * np.pi * side.atoms.site[:, [1, 2, 0]] / (4 * A))
    side.atoms.v[:, 1] += 100.0  # atoms change patches
    advance_by(side, 10)
    atoms = side.atoms
    table = np.hstack([atoms.site, atoms.x, atoms.v, atoms.f, atoms.rest])
    sums = {name: comm.allreduce(value) for name, value in components(side.energies(), 3).items()}
    tables = comm.gather(table)
    if comm.rank == 0:
        table = np.concatenate(tables)
        table = table[np.lexsort(table[:, :3].round(6).T)]
        x, v, f, rest = np.split(table[:, 3:], 4, axis=1)
        energies = np.array([sums[name] for name in ("kinetic", "potential", "external_work")])
        np.savez(out, x=x, v=v, f=f, rest=rest, energies=energies)
    side.close()


if __name__ == "__main__":
    main()

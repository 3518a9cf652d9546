"""MPI program: drive the block by a prescribed motion of the nodes, and save what comes of it.

``mpiexec -n R python drive.py PATCHES_X PATCHES_Y STEPS SCHEME OUTPUT``
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from mpi4py import MPI

from gimpmd_md.side import open_side
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.wire.energies import components
from tests.services.md.block import FORCE, block_case
from tests.services.md.driving import advance


def main() -> None:
    px, py, steps = map(int, sys.argv[1:4])
    comm = MPI.COMM_WORLD
    scheme, out = sys.argv[4], Path(sys.argv[5])
    changes = {} if scheme in ("velocity", "current") else dict(FORCE)
    if scheme == "current":
        changes["continuum__configuration"] = "current"
    if scheme == "absorber":
        changes["coupling__absorber"] = {"rate": 5.0, "temperature": 0.1}
    case = block_case(**changes, md__ranks=px * py, md__patches=[px, py])
    side = open_side(make_plan(case), comm, out.with_suffix(""))
    side.finish()
    x = make_plan(case).background_grid().positions()[side.needs]
    for k in range(steps):
        wave = 0.1 * np.sin(0.2 * k) * np.sin(2.0 * np.pi * x / 26.0)
        advance(side, wave[:, ::-1] + [0.5, -0.4])  # atoms change patches
    fields = {"ids": side.offers, **side.zone_fields()}
    atoms = side.atoms
    table = np.column_stack([atoms.site, atoms.x, atoms.v, atoms.rest])
    ranks = comm.gather((fields, table, components(side.energies(), 2)))
    if comm.rank == 0:
        whole = {name: np.concatenate([rank[0][name] for rank in ranks]) for name in fields}
        order = np.argsort(whole["ids"])
        table = np.concatenate([rank[1] for rank in ranks])
        sums = {name: sum(rank[2][name] for rank in ranks) for name in ranks[0][2]}
        np.savez(
            out,
            **{name: field[order] for name, field in whole.items()},
            atoms=table[np.lexsort(table[:, :2].round(6).T)],  # ids depend on the ranks
            energies=np.array([sums[name] for name in sorted(sums)]),
        )
    side.close()


if __name__ == "__main__":
    main()

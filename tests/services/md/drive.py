"""MPI program: drive the block by a prescribed motion of the nodes, and save what comes of it.

``mpiexec -n R python drive.py PATCHES_X PATCHES_Y STEPS SCHEME MOTION OUTPUT``
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from gimpmd_md.coupling.halo import own_patch
from gimpmd_md.roles import BOUNDARY
from gimpmd_md.side import MdSide, open_side
from gimpmd_schemas.case.plan import Plan, make_plan
from gimpmd_schemas.wire.energies import components
from tests.services.md.block import CENTER, FORCE, RATE, SLIDING, SPINNING, WIDTH, block_case
from tests.services.md.driving import advance, having

MOTIONS = {"drift": {}, "spin": SPINNING, "slide": SLIDING}


def changes_of(scheme: str, motion: str) -> dict[str, Any]:
    """What a scheme and a motion change in the case."""
    changes = {} if scheme in ("velocity", "current") else dict(FORCE)
    changes |= MOTIONS[motion]
    if scheme in ("velocity", "current"):
        changes = {key: value for key, value in changes.items() if not key.startswith("coupling")}
        changes["coupling__zones"] = {"outer": 2.6}
    if scheme == "current":
        changes["continuum__configuration"] = "current"
    if scheme == "absorber":
        temperature = 0.1 if motion == "drift" else 0.0
        changes["coupling__absorber"] = {"rate": 5.0, "temperature": temperature}
    return changes


def velocity_at(motion: str, x: np.ndarray, k: int, dt: float) -> np.ndarray:
    """Mean velocity at lattice positions in coupling step k."""
    if motion == "drift":
        wave = 0.1 * np.sin(0.2 * k) * np.sin(2.0 * np.pi * x / 26.0)
        return wave[:, ::-1] + [0.5, -0.4]
    if motion == "slide":
        return np.where(x[:, :1] < 1.5 * WIDTH, [0.0, 1.0], [0.0, 2.5])
    start, end = (np.array([np.cos(RATE * t), np.sin(RATE * t)]) for t in (k * dt, k * dt + dt))
    (c, s), r = (end - start) / dt, x - CENTER
    return np.column_stack([c * r[:, 0] - s * r[:, 1], s * r[:, 0] + c * r[:, 1]])


def away(side: MdSide, plan: Plan) -> float:
    """Largest distance of the site of a boundary atom from the patch of its rank, in cells."""
    box = np.array(own_patch(plan.atoms.region, plan.atoms.patches, side.atoms.comm))
    d = np.abs(side.atoms.site[having(side, BOUNDARY)] - box.mean(axis=1))
    period = np.where(plan.domain.periodic, np.ptp(np.array(plan.domain.box), axis=1), np.inf)
    beyond = np.minimum(d, period - d) - 0.5 * np.ptp(box, axis=1)
    return float(beyond.max(initial=0.0) / plan.finest_cell)


def main() -> None:
    px, py, steps = map(int, sys.argv[1:4])
    comm = MPI.COMM_WORLD
    scheme, motion, out = sys.argv[4], sys.argv[5], Path(sys.argv[6])
    changes = changes_of(scheme, motion)
    plan = make_plan(block_case(**changes, md__ranks=px * py, md__patches=[px, py]))
    side = open_side(plan, comm, out.with_suffix(""))
    side.finish()
    if motion != "drift":
        side.atoms.v[:] = velocity_at(motion, side.atoms.site, 0, plan.step)
    x = plan.background_grid().positions()[side.needs]
    farthest = 0.0
    for k in range(steps):
        advance(side, velocity_at(motion, x, k, plan.step))  # atoms change patches
        farthest = max(farthest, away(side, plan))
    fields = {"ids": side.offers, **side.zone_fields()}
    atoms = side.atoms
    table = np.column_stack([atoms.site, atoms.x, atoms.v, atoms.rest])
    ranks = comm.gather((fields, table, components(side.energies(), 2)))
    farthest = comm.allreduce(farthest, MPI.MAX)
    if comm.rank == 0:
        whole = {name: np.concatenate([rank[0][name] for rank in ranks]) for name in fields}
        order = np.argsort(whole["ids"])
        table = np.concatenate([rank[1] for rank in ranks])
        sums = {name: sum(rank[2][name] for rank in ranks) for name in ranks[0][2]}
        np.savez(
            out,
            **{name: field[order] for name, field in whole.items()},
            atoms=table[np.lexsort(table[:, :2].round(6).T)],  # ids depend on the ranks
            away=farthest,
            energies=np.array([sums[name] for name in sorted(sums)]),
        )
    side.close()


if __name__ == "__main__":
    main()

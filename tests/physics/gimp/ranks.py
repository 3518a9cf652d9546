"""The same body on one rank and on several, and twice: results to the last bits."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from gimpmd_gimp.points.material_points import join
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver
from tests.mpi import MPIEXEC
from tests.physics.gimp.bodies import body, largest, step_all
from tests.physics.gimp.gates import Check, gate
from tests.physics.gimp.levels import CFL, nested, noise

LAYOUTS = {
    1: {2: [(2,)], 4: [(4,)]},
    2: {2: [(2, 1), (1, 2)], 4: [(2, 2), (4, 1), (1, 4)]},
    3: {2: [(1, 1, 2)], 4: [(2, 2, 1)]},
}
STEPS = 10


def nudged(
    d: int, integrator: str, moving: bool, comm: object = None, layout: object = None
) -> Solver:
    """A body of several levels after some steps; one that moves changes rank and level."""
    cells, finer = nested(d)

    def initial(p) -> None:
        noise(p)
        p.v[:] += 0.1 * moving * np.array([1.0, 0.7, 0.4])[:d]

    method = Method(integrator)  # type: ignore[arg-type]
    solver = body(cells, method, CFL, initial, finer=finer, comm=comm, layout=layout)  # type: ignore[arg-type]
    for _ in range(STEPS * (5 if moving else 1)):
        step_all(solver)
    return solver


def state(solver: Solver) -> np.ndarray:
    """State of all points of all ranks in the order of their ids, one row each."""
    p, comm = solver.points, solver.mesh.comm
    if comm is not None:
        p = join(comm.allgather(p))
    rows = np.column_stack([p.id, p.x, p.v * 1e6, (p.F - np.eye(p.dim)).reshape(p.count, -1) * 1e6])
    return rows[np.argsort(p.id)]


def main() -> None:
    """One rank's part: ``python -m tests.physics.gimp.ranks DIM INTEGRATOR MOVING LAYOUT FILE``."""
    from mpi4py import MPI

    d, integrator, moving, layout, path = sys.argv[1:]
    counts = tuple(int(n) for n in layout.split("x"))
    solver = nudged(int(d), integrator, moving == "1", MPI.COMM_WORLD, counts)
    rows = state(solver)
    if MPI.COMM_WORLD.rank == 0:
        np.save(path, rows)


def on_ranks(d: int, integrator: str, moving: bool, layout: tuple[int, ...]) -> np.ndarray:
    """Run on as many processes as the layout has patches."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "state.npy"
        size = str(int(np.prod(layout)))
        name = "x".join(map(str, layout))
        command = [
            sys.executable,
            "-m",
            "tests.physics.gimp.ranks",
            str(d),
            integrator,
            str(int(moving)),
            name,
        ]
        subprocess.run(
            [MPIEXEC, "-n", size, *command, str(path)],
            check=True,
            timeout=250,
        )
        return np.load(path)


def rank_checks(
    d: int, integrator: str, moving: bool, layouts: list[tuple[int, ...]]
) -> list[Check]:
    alone = state(nudged(d, integrator, moving))
    checks = []
    for layout in layouts:
        shared = on_ranks(d, integrator, moving, layout)
        same = shared.shape == alone.shape and np.array_equal(shared[:, 0], alone[:, 0])
        difference = largest(shared - alone) if same else np.inf
        kind = "moving" if moving else "at rest"
        name = "x".join(map(str, layout))
        what = f"{d}-D, {integrator}, {kind}, 1 rank against {name}, over 1e-6"
        bound = 1e-7 if moving else 1e-8
        checks.append(Check(what, difference, high=bound, source="round-off"))
    return checks


@gate("one rank against two")
def two() -> list[Check]:
    return rank_checks(2, "usavg", False, [(2, 1)])


@gate("one rank against two and four, all layouts", long=True)
def several() -> list[Check]:
    checks = []
    for d, by_size in LAYOUTS.items():
        layouts = [layout for several in by_size.values() for layout in several]
        for integrator in ("usavg", "musl") if d == 2 else ("usavg",):
            checks += rank_checks(d, integrator, False, layouts)
        checks += rank_checks(d, "usavg", True, layouts[-1:])
    return checks


@gate("same bits twice")
def twice() -> list[Check]:
    checks = []
    for d in (1, 2):
        one, other = (state(nudged(d, "usavg", True)) for _ in range(2))
        same = float(np.array_equal(one, other))
        checks.append(
            Check(
                f"{d}-D, three levels, two runs agree to the bit (1: yes)",
                same,
                low=1.0,
                source="exact",
            )
        )
    return checks


if __name__ == "__main__":
    main()

"""Processor time of a coupling step by side and phase, each side alone in one process.

On a machine that others use too, wall times say little, and processor times more. The continuum
gets forces as if from atoms, the atoms get nodes at rest. Cases and blocks are those of
``overhead.py``, with one MD rank and one thread of the continuum.

    python -m tests.benchmarks.processor [--sizes small large full] [--blocks 20]
"""

from __future__ import annotations

import argparse
import contextlib
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from gimpmd_coupler.loop import Side
from gimpmd_deploy.launch.reading import read_case
from gimpmd_deploy.launch.run import make_ready
from gimpmd_gimp.gimp import Gimp
from gimpmd_gimp.side import ContinuumSide
from gimpmd_md.side import open_side
from gimpmd_schemas.case.plan import Plan, load_plan
from tests.benchmarks.beside import BLOCK
from tests.benchmarks.overhead import FULL, SCALES, WARM_UP, write_case

FORCE = 1e-3
"""Forces of the atoms on the nodes (reduced units)."""

Times = dict[str, list[float]]


class Clock:
    """Processor seconds of calls, by name; nested calls count once, with the inner name."""

    def __init__(self) -> None:
        self.times: Times = defaultdict(list)
        self._inner = 0.0

    def timed(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """The same function, timed."""

        def run(*arguments: Any) -> Any:
            outside, self._inner = self._inner, 0.0
            start = time.process_time()
            found = call(*arguments)
            spent = time.process_time() - start
            self.times[name].append(spent - self._inner)
            self._inner = outside + spent
            return found

        return run


def take_steps(side: Side, clock: Clock, fields: dict[str, np.ndarray], steps: int) -> None:
    """The calls of ``run_service`` on one side, timed."""
    finish, receive, advance = (
        clock.timed(name, getattr(side, name)) for name in ("finish", "receive", "advance")
    )
    for _ in range(steps):
        side.zone_fields()
        finish()
        receive(fields)
        advance()
        side.energies()
    side.close()


def of_continuum(plan: Plan, run: Path, steps: int) -> Times:
    """Seconds of the continuum."""
    side = ContinuumSide(plan, Gimp(plan, None, run))
    shape = (side.needs.size, plan.dim)
    force = FORCE * np.random.default_rng(0).standard_normal(shape)
    clock = Clock()
    take_steps(side, clock, {"force": force}, steps)
    return clock.times


def of_atoms(plan: Plan, run: Path, steps: int) -> Times:
    """Seconds of the MD side; ``lammps`` is what LAMMPS takes, and ``advance`` the rest of it."""
    from mpi4py import MPI

    with contextlib.chdir(run / "input"):
        side = open_side(plan, MPI.COMM_WORLD, Path(".."))
        clock = Clock()
        side.atoms.run = clock.timed("lammps", side.atoms.run)
        take_steps(side, clock, {}, steps)
    return clock.times


def show(side: str, times: Times) -> None:
    """Print milliseconds per coupling step: median over the blocks, and the least of them."""
    for name, seconds in times.items():
        blocks = 1e3 * np.reshape(seconds, (-1, BLOCK)).mean(axis=1)[WARM_UP:]
        print(f"  {side:9s} {name:8s} {np.median(blocks):8.3f} ms, least {blocks.min():8.3f}")


def main() -> None:
    """Print the times of each size."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", nargs="+", choices=[*SCALES, FULL], default=list(SCALES))
    parser.add_argument("--blocks", type=int, default=20, help="blocks of four coupling steps")
    options = parser.parse_args()
    steps = BLOCK * (WARM_UP + options.blocks)
    for size in options.sizes:
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary) / "case"
            path, run = write_case(size, folder, apart=True), folder / "run"
            make_ready(read_case(path), path, run, force=False)
            plan = load_plan(run / "plan.yaml")
            print(f"{size}, processor time of a coupling step", flush=True)
            show("continuum", of_continuum(plan, run, steps))
            show("atoms", of_atoms(plan, run, steps))


if __name__ == "__main__":
    main()

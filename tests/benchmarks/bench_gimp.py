"""Speed and memory of GIMP: million point-updates per second, bytes per point.

The solver as runs use it, two dimensions with four points to a cell and three with eight, float64,
uGIMP, one level, without the XPIC filter; beside it, in turn, a hand-fused step that can do nothing
else (``fused_ugimp.py``) and, given a Python that has it, Taichi's (``taichi_ugimp.py``).

    python -m tests.benchmarks.bench_gimp [--taichi PYTHON] [--large] [--rounds 5]

Rates are the best of the rounds, per second of wall time and per second of processor time and
thread; gates for one core use the latter, which other programs disturb less. The gate on threads
needs idle cores: it is not judged where other programs took more than a tenth of one.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import psutil

from gimpmd_gimp.grid.hierarchy import Hierarchy
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.laws import LinearElastic
from gimpmd_gimp.points.distribution import fill
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.solver import Solver
from tests.benchmarks.fused_ugimp import make_step

HERE = Path(__file__).resolve().parent
MODULE = "tests.benchmarks.bench_gimp"
PER_CORE = {"usavg": 9.0, "musl": 12.0, "usl": 12.0}
TAICHI, THREADS, MEMORY = 1.5, 1.7, 8 * 2**30
LARGE = 10_000_000
SHARED = 1_000_000
"""Points from which two threads have to pay off: smaller sweeps are over too soon."""

DISTURBED = 0.1
FEWEST = 300_000
"""Point-updates in one timing, at least."""


@dataclass
class Rate:
    """Million point-updates per second of wall time, and per second of processor and thread."""

    wall: float = 0.0
    core: float = 0.0
    others: float = float("inf")

    def better(self, other: Rate) -> Rate:
        """The best of two timings, and the lesser disturbance."""
        return Rate(
            max(self.wall, other.wall),
            max(self.core, other.core),
            min(self.others, other.others),
        )


def body(points: int, dim: int, integrator: str, threads: int) -> Solver:
    """A square or cube with a smooth velocity field, two points along each axis of a cell."""
    cells = round(points ** (1 / dim) / 2)
    mesh = Mesh(Hierarchy((0.0,) * dim, 1.0 / cells, (cells,) * dim, (False,) * dim))
    material = fill(mesh, 2, 1.0)
    material.v[:] = 0.01 * material.x
    method = Method(integrator=integrator, xpic_every=0)
    law = LinearElastic(1.0, 1.0 / 3.0, 1.0 / 3.0)
    return Solver(mesh, material, law, method, 0.1 / cells, threads=threads)


def busy() -> float:
    """Processor seconds that all programs have used so far."""
    spent = psutil.cpu_times()
    return float(spent.user + spent.system + spent.nice)


def timed(step: Callable[[], object], points: int, threads: int) -> Rate:
    """Rate of some steps in a row."""
    steps = max(1, FEWEST // points)
    all_before, own_before, start = busy(), time.process_time(), time.perf_counter()
    for _ in range(steps):
        step()
    wall, own = time.perf_counter() - start, time.process_time() - own_before
    updates = steps * points / 1e6
    others = max(0.0, busy() - all_before - own) / wall
    return Rate(updates / wall, updates / own * threads, others)


def compare(points: int, dim: int, rounds: int, python: str | None) -> dict[tuple[str, int], Rate]:
    """Rates of all contenders at one size, in turn; keys are names and threads."""
    contenders: dict[tuple[str, int], tuple[Callable[[], object], int]] = {}
    for integrator in PER_CORE:
        for threads in (1, 2):
            solver = body(points, dim, integrator, threads)
            contenders[integrator, threads] = (solver.step, solver.points.count)
    if dim == 2:
        cells = round(points**0.5 / 2)
        contenders["fused by hand, usl", 1] = (make_step(cells), 4 * cells**2)
    rates = dict.fromkeys(contenders, Rate())
    for number in range(rounds + 1):
        for key, (step, count) in contenders.items():
            rate = timed(step, count, key[1])
            if number:  # the first round compiles
                rates[key] = rates[key].better(rate)
    if dim == 2 and python is not None:
        for threads in (1, 2):
            command = [python, str(HERE / "taichi_ugimp.py"), str(points), str(threads)]
            lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout
            wall, core = lines.splitlines()[-1].split()
            rates["Taichi, usl", threads] = Rate(float(wall), float(core), 0.0)
    return rates


def show(points: int, dim: int, rates: dict[tuple[str, int], Rate]) -> list[bool]:
    """Print one size; returns which gates hold."""
    print(f"\n{points:.0e} points, {dim} dimensions")
    print(f"  {'':<20}{'threads':>8}{'M/s wall':>10}{'M/s core':>10}")
    for (name, threads), rate in rates.items():
        print(f"  {name:<20}{threads:>8}{rate.wall:>10.2f}{rate.core:>10.2f}")
    gates = []

    def gate(text: str, value: float, required: float) -> None:
        gates.append(value >= required)
        print(f"  {text:<52}{value:>7.2f} of {required:.2f}  {'ok' if gates[-1] else 'FAILED'}")

    if dim == 2:
        for name, required in PER_CORE.items():
            gate(f"{name}, million updates per second and core", rates[name, 1].core, required)
        if ("Taichi, usl", 1) in rates:
            gate("usl over Taichi", rates["usl", 1].core / rates["Taichi, usl", 1].core, TAICHI)
    for name in PER_CORE:
        two, one = rates[name, 2], rates[name, 1]
        if points < SHARED:
            print(f"  {name}, two threads over one: {two.wall / one.wall:.2f}")
        elif two.others < DISTURBED:
            gate(f"{name}, two threads over one", two.wall / one.wall, THREADS)
        else:
            print(
                f"  {name}, two threads over one: {two.wall / one.wall:.2f}, not judged, as other"
            )
            print(f"    programs took {two.others:.1f} cores")
    return gates


def memory(points: int, dim: int) -> None:
    """Print the peak of this process for so many points, two steps and a sort included."""
    solver = body(points, dim, "usavg", 1)
    for _ in range(2):
        solver.step()
    solver.regroup()
    status = Path("/proc/self/status").read_text(encoding="ascii")
    peak = re.search(r"VmHWM:\s+(\d+) kB", status)  # the maximum of getrusage is the parent's too
    if peak is None:
        raise SystemExit("bench_gimp: /proc/self/status does not tell the peak memory")
    print(solver.points.count, int(peak[1]) * 1024)


def show_memory(large: bool) -> list[bool]:
    """Peak memory of runs in processes of their own, the cost of a point being the difference."""
    gates = []
    print("\nmemory, peak of a whole process")
    for dim in (2, 3):
        sizes = [200_000, 2_000_000, *([LARGE] if large else [])]
        peaks = []
        for size in sizes:
            command = [sys.executable, "-m", MODULE, "--memory", str(size), str(dim)]
            lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout
            count, peak = (int(number) for number in lines.split())
            peaks.append((count, peak))
            print(f"  {dim} dimensions, {count:>10,} points {peak / 2**30:>8.2f} GiB")
        (n0, low), (n1, high) = peaks[:2]
        each = (high - low) / (n1 - n0)
        whole = peaks[-1][1] if large else low + each * (LARGE - n0)
        gates.append(whole <= MEMORY)
        print(
            f"  {dim} dimensions: {each:.0f} bytes a point; 1e7 points take {whole / 2**30:.2f} GiB"
        )
    return gates


def main() -> int:
    """Run the comparison; 1 if a gate fails."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--taichi", metavar="PYTHON", help="an interpreter that has Taichi")
    parser.add_argument("--large", action="store_true", help="hold 1e7 points, not extrapolate")
    parser.add_argument("--memory", nargs=2, type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.memory:
        memory(*options.memory)
        return 0
    gates = []
    for points, dim in ((100_000, 2), (1_000_000, 2), (100_000, 3)):
        gates += show(points, dim, compare(points, dim, options.rounds, options.taichi))
    gates += show_memory(options.large)
    print("\nall gates hold" if all(gates) else "\na gate FAILED")
    return 0 if all(gates) else 1


if __name__ == "__main__":
    sys.exit(main())

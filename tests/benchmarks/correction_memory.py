"""Memory that the correction of the sites scheme takes: counted, and measured.

``python -m tests.benchmarks.correction_memory`` prints a table of regions, cubes and squares, whose
planes have residuals of random changes of the moduli. ``--side 10 --dim 3`` measures one of them.
Each is corrected in a process of its own. What is measured is its largest resident set, less that
before the correction.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from gimpmd_gimp.coupling.sites.correction import correct, corrected
from gimpmd_gimp.coupling.sites.layout import AROUND, Layout
from gimpmd_gimp.coupling.sites.memory import size_of_correction
from gimpmd_gimp.coupling.sites.pieces import cut_cells
from gimpmd_gimp.coupling.sites.shells import Shells
from gimpmd_gimp.coupling.sites.slaves import constraints, find_slaves
from gimpmd_gimp.coupling.sites.touched import touched
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.mechanics.elasticity import VOIGT, unit_strains, voigt_place

SIDES = {2: (30, 100, 300), 3: (2, 4, 6, 8)}
"""Cells along the sides of the regions, by dimension."""

MARGIN, SHARE, BETWEEN = 4, 0.3, {2: 1.5, 3: 0.6}
"""Continuum around a region, the share of the cell that plane 1 leaves to it, and the distance of
the planes, in cells."""


def layout(dim: int, side: float) -> Layout:
    """A region of atoms with cells of unit size around it."""
    low, high = MARGIN + SHARE, MARGIN + SHARE + side
    shells = Shells(
        free=(((low, high),) * dim,),
        active=(((low - BETWEEN[dim], high + BETWEEN[dim]),) * dim,),
    )
    count = int(np.ceil(high + BETWEEN[dim])) + MARGIN
    grid = BackgroundGrid((0.0,) * dim, 1.0, (count,) * dim, (False,) * dim)
    pieces = cut_cells(grid, shells, AROUND)
    covered = touched(*pieces.take(~pieces.free).slopes(grid))
    slaves = find_slaves(grid, shells, covered)
    return Layout(grid, shells, pieces, constraints(grid, slaves, covered))


def residual(found: Layout) -> np.ndarray:
    """Nodal forces, by strain, of random changes of the moduli."""
    pieces = found.pieces.take(corrected(found.pieces, found.shells, found.grid.cell))
    c, place = len(VOIGT[found.grid.dim]), voigt_place(found.grid.dim)
    half = np.random.default_rng(5).normal(size=(len(pieces.x), c, c))
    P = pieces.volume[:, None, None, None] * (half + half.swapaxes(1, 2))[:, place]
    slopes = pieces.slopes(found.grid)
    return np.stack(
        [sum(slope.T @ P[:, :, j, m] for j, slope in enumerate(slopes)) for m in range(c)]
    )


def stress(dim: int) -> np.ndarray:
    """Derivative of the stress of an isotropic body in each strain."""
    H = unit_strains(dim)
    return np.array([np.trace(E) * np.eye(dim) + E + E.T for E in H])


def resident(key: str) -> int:
    """``VmRSS`` or ``VmHWM`` of this process, bytes."""
    (line,) = [n for n in Path("/proc/self/status").read_text().splitlines() if n.startswith(key)]
    return 1024 * int(line.split()[1])


def measure(dim: int, side: int) -> str:
    """Correct a region in this process; returns a row of the table."""
    found, start = layout(dim, side), time.perf_counter()
    size = size_of_correction(found)
    counting = time.perf_counter() - start
    change = residual(found)
    pieces = found.pieces.take(corrected(found.pieces, found.shells, found.grid.cell))
    at_rest = np.zeros((found.grid.size, dim))
    Path("/proc/self/clear_refs").write_text("5")  # the peak starts anew
    before, start = resident("VmRSS"), time.perf_counter()
    correct(found.grid, pieces, found.T, at_rest, change, stress(dim))
    taken = time.perf_counter() - start
    measured = resident("VmHWM") - before
    return (
        f"{dim:3}  {side:4}  {len(pieces.x):6}  {size.equations:9}  {size.memory / 2**20:8.1f}  "
        f"{measured / 2**20:8.1f}  {size.memory / measured:7.2f}  {counting:8.2f}  {taken:7.1f}"
    )


def main() -> None:
    """Print the table, or a row of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--dim", type=int, choices=(2, 3))
    parser.add_argument("--side", type=int, help="cells along a side of the region")
    options = parser.parse_args()
    if options.side is not None and options.dim is not None:
        print(measure(options.dim, options.side))
        return
    print("dim  side  pieces  equations  counted   measured  quotient  counting  correcting")
    print("                              MiB       MiB                 s         s")
    for dim in (2, 3) if options.dim is None else (options.dim,):
        for side in SIDES[dim] if options.side is None else (options.side,):
            words = [sys.executable, "-m", __spec__.name, "--dim", str(dim), "--side", str(side)]
            print(subprocess.run(words, check=True, capture_output=True, text=True).stdout, end="")


if __name__ == "__main__":
    main()

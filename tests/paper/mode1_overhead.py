"""What the coupling costs at full size: the mode I crack against bare LAMMPS, in turn."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from gimpmd_deploy.results.run import Run
from tests.benchmarks.overhead import FULL, LIMITS, WARM_UP, time_blocks
from tests.paper.page import Result, Row

NAME = "mode1-overhead"
WAYS = {"two MD ranks and the continuum on two cores": False, "a core for each process": True}
"""How processes share the cores, and whether each has one of its own."""


def measure(runs: Mapping[str, Run], folder: Path) -> Result:
    """Ratio of the times of coupled and bare steps, measured once for the folder of runs."""
    rows = []
    for way, apart in WAYS.items():
        name = f"{NAME}-apart" if apart else NAME
        stored = folder / f"{name}.csv"
        if not stored.is_file():
            np.savetxt(stored, time_blocks(FULL, folder / name, apart), delimiter=",")
        times = np.loadtxt(stored, delimiter=",")
        ratios = times[:, 0] / times[:, 1]
        low, median, high = np.percentile(ratios, [25, 50, 75])
        rows.append(
            Row("5.1", f"wall time of a coupling step over that of bare LAMMPS, {way}, median "
                "(quartiles)", "-",
                f"{median:.3f} ({low:.3f} to {high:.3f}; at most {LIMITS[FULL]:.2f} wanted)", name)
        )  # fmt: skip
    return Result("Cost of the coupling at full size", TEXT.format(len(times), WARM_UP), rows)


TEXT = """
A bare LAMMPS with the same script, atoms, ranks and time step takes steps in the processes of the
run, in turn with the coupled steps: {} blocks of four coupling steps each, after {} that do not
count. `python -m tests.benchmarks.overhead --sizes full --runs 1` prints the same; with `--apart`
it takes one MD rank and one thread of the continuum, so that on two cores each has its own. The
host was uneven when this was measured: on another day the first kind gave 1.04 to 1.11, with
quartiles up to 0.6 apart.
"""

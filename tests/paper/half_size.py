"""The mode I crack at half size: coupled against pure MD of the same whole body."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gimpmd_deploy.analysis.crack import crack_growth
from gimpmd_deploy.figures.style import COLOURS, pyplot, save, unit_label
from gimpmd_deploy.results.compare import Comparison, compare
from gimpmd_deploy.results.run import Run
from tests.paper.jobs import Job
from tests.paper.page import Result, Row, picture

COUPLED, ATOMS = "half-size", "half-size-md"
LIMITS = (-1.2, 1.2)
SHOWN_ERROR = 20.0
"""Largest difference in the figure, in percent: before the wave arrives it means nothing."""

HALF: dict[str, Any] = {
    "domain.box": [[0, 984], [0, 904]],
    "grid": {"cell": 8, "levels": [{"boxes": [[[0, 480], [264, 640]]]}]},
    "time.end": 80,
    "md.region": [[0, 445], [302, 602]],
    "md.variables": {"crack_length": 249, "crack_plane": 452},
    "continuum.cracks": [{"from": [0, 452], "to": [249, 452]}],
    "boundary.top.value": [0, 0.5],
    "boundary.bottom.value": [0, -0.5],
    "output.interval": 4,
}
"""Half of the lengths of ``mode1``, with two levels; at 0.5 the crack grows within the run."""

TIMED = HALF | {"time.end": 3.2, "output.interval": 3.2}
"""The first forty steps, for the wall time."""

PAIRS = [
    (
        Job(f"half-size-time-{number}", "mode1", TIMED),
        Job(f"half-size-md-time-{number}", "mode1", TIMED, ("--only", "md")),
    )
    for number in range(1, 4)
]
"""Short runs, coupled and pure MD in turn."""

JOBS = [
    Job(COUPLED, "mode1", HALF),
    Job(ATOMS, "mode1", HALF, ("--only", "md")),
    *(job for pair in PAIRS for job in pair),
]


def measure(runs: Mapping[str, Run], folder: Path) -> Result:
    """Errors over time, crack tip, wall time and memory of both runs."""
    coupled, atoms = runs[COUPLED], runs[ATOMS]
    found = compare(coupled, atoms)
    tips = [crack_growth(run) for run in (coupled, atoms)]
    ahead = tips[0].length - tips[1].length
    counts = [len(run.atoms(run.times[0])) for run in (coupled, atoms)]
    pairs = [[_step_seconds(runs[job.name]) for job in pair] for pair in PAIRS]
    seconds = np.median(pairs, axis=0)
    slower = float(np.median([pair[1] / pair[0] for pair in pairs]))
    memory = [sum(run.timings.memory.values()) / 2**20 for run in (coupled, atoms)]
    more = counts[1] / counts[0]
    last = found.differences[-1]
    rows = [
        Row("5.2", "atoms, coupled and pure MD", "0.5 and 3.3 million", "{} and {}".format(*counts),
            COUPLED),
        Row("-", f"error of the displacement at t = {last.time:.0f}, MD region, continuum", "-",
            f"{last.displacement_md:.2%}, {last.displacement_continuum:.2%}", COUPLED),
        Row("-", f"error of sigma_yy at t = {last.time:.0f}, MD region, continuum", "-",
            f"{last.stress_md:.2%}, {last.stress_continuum:.2%}", COUPLED),
        Row("-", "crack tip ahead of that of pure MD, largest at any output (atom spacings)", "-",
            f"{np.abs(ahead).max() / tips[1].spacing:.1f}", COUPLED),
        Row("-", "advance of the crack, coupled and pure MD", "-",
            ", ".join(f"{tip.length[-1] - tip.length[0]:.1f}" for tip in tips), COUPLED),
        Row("5.2", "wall time of a step, coupled and pure MD (s)", "8 % less",
            f"{seconds[0]:.3f}, {seconds[1]:.3f} ({1.0 - 1.0 / slower:.0%} less)",
            PAIRS[0][0].name),
        Row("-", "ratio of wall times over ratio of atoms", "-", f"{slower / more:.3f}",
            PAIRS[0][0].name),
        Row("5.2", "memory of all processes, coupled and pure MD (MiB)", "30 % less",
            f"{memory[0]:.0f}, {memory[1]:.0f} ({1.0 - memory[0] / memory[1]:.0%} less)", COUPLED),
    ]  # fmt: skip
    figures = [
        (_draw_errors(coupled, found, folder / "images" / f"{COUPLED}-errors.png"),
         "Errors over time, relative L2."),
        *((picture(run, "sigma_yy", last.time, folder, LIMITS), f"{title}, t = {last.time:g}.")
          for run, title in ((coupled, "Coupled"), (atoms, "Pure MD"))),
    ]  # fmt: skip
    return Result("Coupled against pure MD at half size", TEXT, rows, figures)


def _step_seconds(run: Run) -> float:
    """Wall seconds of a coupling step, by their median: without the start."""
    steps = np.sum(list(run.timings.phases["md"].values()), axis=0)
    return float(np.median(steps))


def _draw_errors(run: Run, found: Comparison, path: Path) -> Path:
    figure, axes = pyplot().subplots(figsize=(6.4, 4.0))
    kinds = (("displacement", "-"), ("stress", "--"))
    places = (("md", "MD region", COLOURS[0]), ("continuum", "continuum", COLOURS[5]))
    times = [row.time for row in found.differences]
    for kind, dashes in kinds:
        for place, label, colour in places:
            values = [getattr(row, f"{kind}_{place}") for row in found.differences]
            values = [np.nan if value is None else 100.0 * value for value in values]
            name = "displacement" if kind == "displacement" else "$\\sigma_{yy}$"
            axes.plot(times, values, dashes, color=colour, lw=1.6, label=f"{name}, {label}")
    axes.set_xlabel(f"time ({unit_label(run.plan.units, 'time')})")
    axes.set_ylabel("difference from pure MD (%)")
    axes.set_yscale("log")
    axes.set_ylim(None, SHOWN_ERROR)
    axes.legend(fontsize=9)
    return save(figure, path)


TEXT = """
This is the largest size whose pure MD takes less than 40 minutes on two cores that do nothing
else: 1000 coupling steps of 1.7 s. The load is 0.5, so that the crack grows within the run. The
wave reaches the MD region at t = 36. Before that its atoms hardly move, and a relative difference
means nothing there.

The difference in the continuum is that of its grid: the front of the wave is steeper in the
atoms. The difference in the MD region falls while the stress rises, and the tip is at the same
atom in both runs at all times.

Wall times are medians of the steps in three pairs of short runs, coupled and pure MD in turn. The
long runs shared the machine with other work, so their wall times are longer. The paper does not
say why its coupled run saves so little time.
"""

"""Atomic friction between two plates (paper figures 16 to 19)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from gimpmd_deploy.analysis.mach import mach_angle
from gimpmd_deploy.analysis.plane import Plane
from gimpmd_deploy.analysis.slip import (
    SlipHistory,
    pulse_speed,
    row_profile,
    sliding_patches,
    slip_events,
    slip_history,
    stick_slip,
)
from gimpmd_deploy.figures.style import COLOURS, pyplot, save, unit_label
from gimpmd_deploy.figures.windows import Window
from gimpmd_deploy.results.run import Run
from gimpmd_schemas.arrays import Floats
from tests.paper.jobs import Job
from tests.paper.page import Result, Row, picture

FULL, COUPLED, ATOMS = "friction", "friction-half", "friction-half-md"
OUTSIDE = "friction-half-outside"
LAST = 112.0
"""Time of figures 17 and 19."""
SHOWN = (56.0, 64.0, 72.0)
"""Times of figure 18."""
LIMITS = (-0.7, 0.7)
"""Colour scale of velocities."""
FIRST, CALM = 80.0, 0.8
"""Pulses are followed from here, beside the slit, to this part of the weak interface."""
BLUE, WIDTH = 0.7, 0.1
"""Velocity to the left in the blue spots of figure 17, and how far it may differ."""
SQUARE = 16.0
"""Edge of the squares over which velocities are averaged: waves that are shorter have no place in
the grid."""
HEIGHTS = (6.0, 60.0)
"""Distances from the interface of the atoms that show Mach lines: beyond the rows that slip."""

HALF: dict[str, Any] = {
    "domain.box": [[0, 984], [0, 904]],
    "grid": {"cell": 8, "levels": [{"boxes": [[[0, 480], [264, 640]]]}]},
    "md.region": [[0, 445], [302, 602]],
    "md.variables": {"interface": 452, "slit": 67, "end": 400},
    "boundary.left": [
        {"condition": "velocity", "value": [0.1, -0.003], "extent": [[0, 452]]},
        {"condition": "velocity", "value": [-0.1, 0.003], "extent": [[452, 904]]},
    ],
    "output.interval": 4,
}
"""Half of the lengths, with the same slit and loads; two levels."""

BESIDE: dict[str, Any] = {
    "boundary.left": [
        {"condition": "velocity", "value": [0.1, -0.003], "extent": [[0, 302]]},
        {"condition": "velocity", "value": [-0.1, 0.003], "extent": [[602, 904]]},
    ],
    "time.end": 64,
    "output.figures": [],
}
"""The plates are driven by the continuum alone: the left face of the MD region is free."""

JOBS = [
    Job(FULL, "friction"),
    Job(COUPLED, "friction", HALF),
    Job(ATOMS, "friction", HALF, ("--only", "md")),
    Job(OUTSIDE, "friction", {**HALF, **BESIDE}),
]


def measure(runs: Mapping[str, Run], folder: Path) -> Result:
    """Slip over time, Mach lines, the row at the interface, and coupled against pure MD."""
    run = runs[FULL]
    plane, history = plane_of(run), history_of(run)
    events = slip_events(history)
    reach = CALM * _end(run)
    pulse = pulse_speed(events.between(FIRST, 0.5 * reach))
    front = float(np.nanmax(events.position[np.isfinite(events.time[0])]))
    lines = mach_angle(run.atoms(LAST), plane, (FIRST, min(front, reach)), HEIGHTS)
    slid = stick_slip(history)
    shear = run.plan.wave_speed("S")
    rows = [
        Row("18", "first slips at the end of the slit", "56, 64, 72", _firsts(run), FULL),
        Row("18", f"speed of the first pulse (c_s = {shear:.2f})", "3.2",
            f"{pulse.speed:.2f} +- {pulse.error:.2f}", FULL),
        Row("18", "angle of the Mach lines, above and below (degrees)", "45",
            f"{lines.above:.0f}, {lines.below:.0f} (share {lines.share:.2f})", FULL),
        Row("17", f"share of the slipped interface that slides, t = {LAST:g}", "small",
            f"{slid.sliding[-1]:.0%}", FULL),
        Row("19", "slip rate behind the pulses over the largest rate (self-healing)",
            "small", f"{slid.behind[-1]:.2f}", FULL),
        *_spots(run, history),
        Row("18", "first slips at half size, left face of the MD region free, until t = 64",
            "56, 64", _firsts(runs[OUTSIDE]), OUTSIDE),
        *_against_md(runs[COUPLED], runs[ATOMS]),
    ]  # fmt: skip
    return Result("Atomic friction", TEXT, rows, _figures(runs, plane, folder))


def plane_of(run: Run) -> Plane:
    """The interface of a case of ``examples/friction``."""
    return Plane.through((0.0, run.case.atoms.variables["interface"]), (1.0, 0.0))


def history_of(run: Run) -> SlipHistory:
    """Slip along the weak part of the interface."""
    variables = run.case.atoms.variables
    return slip_history(run, plane_of(run)).between(variables["slit"], variables["end"])


def _spots(run: Run, history: SlipHistory) -> list[Row]:
    """Relative velocity in the spots of figure 17 that slip, and between them."""
    row, x = row_profile(run.atoms(LAST), plane_of(run)), history.position
    weak = (x[0] <= row.position) & (row.position <= x[-1])
    blue = weak & (np.abs(-row.velocity - BLUE) < WIDTH)
    spots = np.abs(row.relative_velocity[blue])
    slips = [(one.start <= x) & (x <= one.end) for one in sliding_patches(history, -1)]
    between = np.abs(history.rate[-1][~np.any(slips, axis=0)])
    return [
        Row("17", f"relative velocity of the {spots.size} atoms above the interface that move to "
            f"the left at {BLUE - WIDTH:.1f} to {BLUE + WIDTH:.1f}, t = {LAST:g}: mean, range",
            "0.8", f"{spots.mean():.2f}, {spots.min():.2f} to {spots.max():.2f}", FULL),
        Row("17", "the same where the interface sticks: half, and nine of ten, are below",
            "0 to 0.2", f"{np.median(between):.2f}, {np.quantile(between, 0.9):.2f}", FULL),
        Row("17", "largest relative velocity, and largest velocity to the left", "-",
            f"{np.abs(history.rate[-1]).max():.2f}, {-row.velocity[weak].min():.2f}", FULL),
    ]  # fmt: skip


def _end(run: Run) -> float:
    return float(run.case.atoms.variables["end"])


def _firsts(run: Run) -> str:
    """Times of the first slips beside the slit."""
    times = slip_events(history_of(run)).first[:3]
    return ", ".join(f"{time:.0f}" for time in times) or "none"


def _against_md(coupled: Run, atoms: Run) -> list[Row]:
    """Slip events and velocities of the coupled run against those of pure MD."""
    found = [slip_events(history_of(run)) for run in (coupled, atoms)]
    firsts = [", ".join(f"{time:.1f}" for time in one.first[:3]) for one in found]
    a, b = (one.time[0] for one in found)
    both = np.isfinite(a) & np.isfinite(b)
    u, v, means = _differences(coupled, atoms)
    return [
        Row("17", "first slips at half size, coupled; pure MD", "match well", "; ".join(firsts),
            COUPLED),
        Row("17", "time of the first slip of an atom, coupled less pure MD, RMS", "match well",
            f"{np.sqrt(np.mean((a - b)[both] ** 2)):.2f}", COUPLED),
        Row("17", f"difference of the displacements in the MD region, t = {LAST:g}, relative L2",
            "-", f"{u:.2%}", COUPLED),
        Row("17", f"the same of velocities: means over squares of {SQUARE:g}; of single atoms",
            "contours match well", f"{means:.0%}; {v:.0%}", COUPLED),
    ]  # fmt: skip


def _differences(coupled: Run, atoms: Run) -> tuple[float, float, float]:
    """Relative differences of the free atoms of a coupled run from those of pure MD.

    Of displacements, of velocities, and of means of the velocities over squares of `SQUARE`.
    """
    mine, theirs = coupled.atoms(LAST), atoms.atoms(LAST)
    zones = coupled.plan.coupled.zones
    mine = mine.where(zones.depth(mine.reference) > zones.innermost)
    same = cKDTree(theirs.reference).query(mine.reference)[1]
    u, v = theirs.position - theirs.reference, theirs.velocity
    square = np.unique(np.floor(mine.reference / SQUARE), axis=0, return_inverse=True)[1].ravel()
    means = [
        np.stack([np.bincount(square, axis) / np.bincount(square) for axis in velocity.T])
        for velocity in (mine.velocity, v[same])
    ]
    return (
        _relative(mine.position - mine.reference, u[same]),
        _relative(mine.velocity, v[same]),
        _relative(*means),
    )


def _relative(mine: Floats, theirs: Floats) -> float:
    return float(np.linalg.norm(mine - theirs) / np.linalg.norm(theirs))


def _figures(runs: Mapping[str, Run], plane: Plane, folder: Path) -> list[tuple[Path, str]]:
    run = runs[FULL]
    shown: list[tuple[Run, str, float, str]] = [
        (run, "full size", LAST, "figure 17"),
        *((run, "full size", time, "figure 18") for time in SHOWN),
        (runs[COUPLED], "half size, coupled", LAST, "figure 17"),
        (runs[ATOMS], "half size, pure MD", LAST, "figure 17"),
    ]
    figures = [
        (picture(one, "velocity_x", time, folder, LIMITS, _around(one)),
         f"Velocity along x, {size}, t = {time:g} ({number}).")
        for one, size, time, number in shown
    ]  # fmt: skip
    row = _draw_row(run, plane, folder / "images" / f"{FULL}-row.png")
    figures.append((row, f"Atoms along the slip plane at t = {LAST:g} (figure 19)."))
    return figures


def _around(run: Run) -> Window:
    """The whole MD region of the coupled case."""
    (x0, x1), (y0, y1) = run.case.atoms.region
    return ((x0, x1), (y0, y1))


def _draw_row(run: Run, plane: Plane, path: Path) -> Path:
    """Velocity and potential energy of the row above the slip plane, as figure 19."""
    atoms, zones, units = run.atoms(LAST), run.plan.coupled.zones, run.plan.units
    row = row_profile(atoms.where(zones.depth(atoms.reference) > zones.innermost), plane)
    figure, (upper, lower) = pyplot().subplots(2, 1, figsize=(7.6, 5.0), sharex=True)
    upper.plot(row.position, row.velocity, color=COLOURS[0], lw=0.9)
    upper.set_ylabel(f"velocity along x ({unit_label(units, 'velocity')})")
    lower.plot(row.position, row.potential_energy, color=COLOURS[5], lw=0.9)
    lower.set_ylabel(f"potential energy\nof an atom ({unit_label(units, 'energy')})")
    lower.set_xlabel(f"x ({unit_label(units, 'length')})")
    return save(figure, path)


TEXT = """
At half size, atoms of the coupled run and of pure MD slip at the same times, and their
displacements agree to .3 %. Velocities agree as long as one looks at more than a few atoms. The
slip pulses emit waves of a few atom spacings. No grid can take these over: the planes reflect
them, and single atoms then move differently. A monitor says so during the run.

Slips begin at the end of the slit and follow each other in nearly the time that the paper gives,
8, and the pulses run at nearly its speed. But the paper sees the first one at t = 56, long after
the plates have begun to move there. The next section shows what sets this time: a face velocity
that grows over 80 gives the times of the paper. A shear wave needs 55 from the left face of the
paper's continuum, beyond the MD region, to the interface. So its atoms might not be driven
themselves. At half size, where that wave arrives at 27, such a run has no slip until t = 64. So
this does not explain the difference.

In the spots that slip, atoms above the interface move to the left. Where they do so at 0.7, the
plates move relative to each other at 0.8, as in the paper. A few move faster.

The pulses are slower than shear waves (5.47). So what trails behind them are no Mach lines of one
pulse. They are fronts of the waves that the pulses emit one after another.
"""

"""Which set-up gives the first slips of the paper (figure 18): a small model, one change a run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gimpmd_deploy.analysis.slip import SlipHistory, slip_events
from gimpmd_deploy.figures.style import COLOURS, SOFT, pyplot, save, unit_label
from gimpmd_deploy.results.run import Run
from gimpmd_schemas.arrays import Floats
from tests.paper.friction import history_of
from tests.paper.jobs import Job
from tests.paper.page import Result, Row

PAPER = (56.0, 64.0, 72.0)
"""Times of the first slips in the paper."""
OUTPUTS = 8.0
"""Interval of the outputs in the paper: all times of its figures are multiples of it."""
MIDDLE, TOP = 448, 896
"""Heights of the interface and of the upper face."""
SLIT, END = 67, 165
"""Ends of the slit and of the weak interface."""


def _driven(speed: float, timing: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Both halves of the left face."""
    parts = ((speed, -0.003, 0, MIDDLE), (-speed, 0.003, MIDDLE, TOP))
    return [
        {"condition": "velocity", "value": [x, y], "extent": [[low, high]], **timing}
        for x, y, low, high in parts
    ]


SMALL: dict[str, Any] = {
    "domain.box": [[0, 992], [0, TOP]],
    "time.md_timestep": 0.004,
    "time.md_steps": 20,
    "grid": {
        "cell": 16,
        "levels": [{"boxes": [[[0, 256], [320, 576]]]}, {"boxes": [[[0, 208], [384, 512]]]}],
    },
    "md.region": [[0, 180], [408, 488]],
    "md.variables": {"interface": MIDDLE, "slit": SLIT, "end": END},
    "md.ranks": 1,
    "md.patches": [1, 1],
    "continuum.threads": 1,
    "boundary.left": _driven(0.1, {}),
    "output.interval": 0.64,
    "output.figures": [],
    "time.end": 48,
}
"""About half of the lengths, fewer atoms around the same slit, the same loads, MD steps of 0.004. A
wave takes 105 to the right face, so its distance does not matter."""


class SetUp(NamedTuple):
    """One change of the small model: how the page names it, and keys of the case."""

    title: str
    changes: Mapping[str, Any]


def _ramp(time: float, end: float) -> SetUp:
    changes = {"boundary.left": _driven(0.1, {"ramp": time}), "time.end": end}
    return SetUp(f"the velocity of the face grows over {time:g}", changes)


LONG_SLIT = 498
"""The edge crack of the other problem, whose model has the same size."""

SET_UPS = {
    "friction-small": SetUp("as `examples/friction`", {}),
    "friction-small-strong": SetUp(
        "interface as strong as the crystal (cutoff 2.5)",
        {"md.variables": {"interface": MIDDLE, "slit": SLIT, "end": END, "break": 2.5}},
    ),
    "friction-small-slow": SetUp("face velocity 0.07", {"boundary.left": _driven(0.07, {})}),
    "friction-small-damped": SetUp(
        "continuum damped at a rate of 0.02",
        {"continuum.damping": [{"rate": 0.02}], "time.end": 40},
    ),
    "friction-small-ramp50": _ramp(50, 64),
    "friction-small-ramp80": _ramp(80, 80),
    "friction-small-long": SetUp(
        f"slit of {LONG_SLIT}, the edge crack of the other problem",
        {
            "md.region": [[0, 600], [413, 483]],
            "grid": {
                "cell": 16,
                "levels": [
                    {"boxes": [[[0, 720], [320, 576]]]},
                    {"boxes": [[[0, 656], [376, 520]]]},
                ],
            },
            "md.variables": {"interface": MIDDLE, "slit": LONG_SLIT, "end": 580},
            "time.end": 88,
        },
    ),
}

JOBS = [Job(name, "friction", {**SMALL, **one.changes}) for name, one in SET_UPS.items()]


class Found(NamedTuple):
    """First slips of a run, and the first pulse as outputs ``OUTPUTS`` apart show it.

    Attributes
    ----------
    first : times of the first slips.
    shifts : range of times that, added to all, let the outputs show the slips when the paper does;
        None: there is no such time.
    speed : mean speed of the pulse over the first two intervals.
    rate : largest relative velocity across the interface in that time.
    """

    first: Floats
    shifts: tuple[float, float] | None
    speed: float
    rate: float


def measure(runs: Mapping[str, Run], folder: Path) -> Result:
    """First slips of all set-ups, and the slip at the end of the slit over time."""
    histories = {name: history_of(run) for name, run in runs.items()}
    rows = [
        Row("18", f"{SET_UPS[name].title}: first slips; later by; first pulse: speed, velocity",
            "56, 64, 72; -; 3.2, 0.8", _described(found_in(history)), name)
        for name, history in histories.items()
    ]  # fmt: skip
    figure = _draw(histories, folder / "images" / "friction-small-slips.png")
    caption = "Slip beside the end of the slit, and first slips of the paper (dotted)."
    return Result("Atomic friction: what sets the time of the first slips", TEXT, rows,
                  [(figure, caption)])  # fmt: skip


def found_in(history: SlipHistory) -> Found:
    """First slips of a history that begins at the end of the slit; see `Found`."""
    events = slip_events(history)
    first = events.first
    if first.size < len(PAPER):
        return Found(first, None, np.nan, np.nan)
    start, end = first[0], first[0] + 2.0 * OUTPUTS
    reached = events.position[events.time[0] <= end].max() - events.origin[0]
    while_running = (history.time >= start) & (history.time <= end)
    rate = np.abs(history.rate[while_running]).max()
    return Found(first, shifts(first), float(reached / (end - start)), float(rate))


def shifts(first: Floats) -> tuple[float, float] | None:
    """Times by which slips may come later so that each is first seen at an output of the paper."""
    latest = np.array(PAPER) - first[: len(PAPER)]
    low, high = float((latest - OUTPUTS).max()), float(latest.min())
    return (low, high) if low < high else None


def _described(found: Found) -> str:
    first = ", ".join(f"{time:.1f}" for time in found.first[: len(PAPER)]) or "none"
    if found.first.size < len(PAPER):
        return f"{first}; -; -"
    shift = "no time" if found.shifts is None else "{:.0f} to {:.0f}".format(*found.shifts)
    return f"{first}; {shift}; {found.speed:.1f}, {found.rate:.2f}"


def _draw(histories: Mapping[str, SlipHistory], path: Path) -> Path:
    """Slip of the first atom beside the slit over time, for each set-up."""
    figure, axes = pyplot().subplots(figsize=(6.4, 4.2))
    for time in PAPER:
        axes.axvline(time, color=SOFT, lw=0.8, ls=":")
    dashes = ("-", "--", "-.", ":")
    for index, (name, history) in enumerate(histories.items()):
        slip = np.abs(history.slip[:, 0]) / history.period
        style = {"color": COLOURS[index % len(COLOURS)], "ls": dashes[index % len(dashes)]}
        axes.plot(history.time, slip, lw=1.6, label=name.removeprefix("friction-"), **style)
    axes.set_xlabel(f"time ({unit_label('lj', 'time')})")
    axes.set_ylabel("slip (lattice steps)")
    axes.set_ylim(0.0, 5.0)
    axes.legend(fontsize=8, loc="upper left")
    return save(figure, path)


TEXT = """
All times at which the paper shows its model are multiples of 8, 100 steps of its continuum. If its
outputs are 8 apart, its first slips, at 56, 64 and 72, say no more than that one slip began within
the 8 before each of these outputs. In the table, "later by" is the range of times by which our
slips would have to come later, so that outputs 8 apart show them at 56, 64 and 72. Speed and
largest relative velocity are those of the first pulse within 16 from its beginning: two outputs.

The small model slips as the full one does (13, 24, 31). If all came 35 to 40 later, the paper's
outputs would show these slips at 56, 64 and 72. So 8 may be the interval of its outputs, not of its
slips. A pulse begins slowly: over two outputs it runs at nearly the speed of the paper, and later
at that of the table above. So what differs is the beginning.

The strength of the interface does not matter: with the full potential across it, the times are the
same. A cutoff with or without a shift of the energy has the same forces, so it cannot matter
either. What counts is how far the plates have moved beside the slit. At 0.1 from t = 0 on, their
faces have moved 11 relative to each other at t = 56, ten steps of the lattice, over a slit of 67.
So in the paper the plates cannot have moved like this from t = 0 on.

If the velocity of the face grows linearly over 80, the slips come at 49, 60 and 69: the outputs
show them exactly when the paper does. If it grows over 50, or is 0.07 from the start, they come too
early. A strong damping of the continuum moves them by 0.3. A slit as long as the edge crack of the
other problem, and not 67, delays them by the way of a longitudinal wave: the outputs show them at
64, 72 and 80. So a slow beginning of the load would explain the times. The paper does not say that
it had one; a load that begins 35 to 40 later does the same.

The largest relative velocity is 1.0 to 1.1 in all of these runs. The 0.8 of the paper is that of
its blue spots, which move at 0.7, and no largest value. The section before compares these.
"""

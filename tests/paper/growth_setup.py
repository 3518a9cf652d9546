"""What moves start and arrest of the mode I crack (paper 5.1): one change in small runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from gimpmd_deploy.analysis.crack import CrackGrowth, crack_growth
from gimpmd_deploy.figures.style import COLOURS, SOFT, pyplot, save, unit_label
from gimpmd_deploy.results.run import Run
from tests.paper.jobs import QUARTER, Job
from tests.paper.mode1_growth import away, by_the_paper, shown_time
from tests.paper.page import Result, Row

PAPER = (225.0, 334.0)
"""Start and arrest of the crack in the paper, at full size."""
FROM = 50.0
"""The tip is followed from here: before, it has not moved in any of these runs."""


def _load(history: list[list[float]]) -> dict[str, Any]:
    """The load of the full size at twice the value, with a history in a quarter of its times."""
    return {
        f"boundary.{face}": {"condition": "traction", "value": [0, value], "history": history}
        for face, value in (("top", 0.3), ("bottom", -0.3))
    }


SMALL: dict[str, Any] = {
    "time.end": 90,
    "time.md_timestep": 0.004,
    "time.md_steps": 20,
    "md.region": [[0, 222], [181, 271]],
    "md.ranks": 1,
    "md.patches": [1, 1],
    "continuum.threads": 1,
    "output.interval": 0.64,
    "output.figures": [],
    **_load([[0, 0], [2.5, 1], [52.5, 1], [55, 0]]),
}
"""``mode1-small`` with fewer atoms, MD steps of 0.004 and the load of figures 14 and 15."""


class SetUp(NamedTuple):
    """One change of the small model: how the page names it, and its run."""

    title: str
    job: Job


def _small(name: str, changes: Mapping[str, Any]) -> Job:
    return Job(name, "mode1-small", {**SMALL, **changes})


def _at_once(job: Job) -> Job:
    """Return a run at a quarter of the size whose load comes and goes at once."""
    history = [[0, 1], [52.5, 1], [52.58, 0]]
    changes = {f"boundary.{face}.history": history for face in ("top", "bottom")}
    return replace(job, name=f"{job.name}-at-once", changes={**job.changes, **changes})


DAMPED: dict[str, Any] = {"continuum.damping": [{"rate": 0.004}]}
UNDAMPED = _small("growth-small", {})
SET_UPS = [
    SetUp("undamped", UNDAMPED),
    SetUp("damped continuum", _small("growth-small-damped", DAMPED)),
    SetUp("load at once", _at_once(UNDAMPED)),
    *(
        SetUp(f"load at once, scheme of the paper, {name}", _at_once(by_the_paper(name)))
        for name in ("MUSL", "USL")
    ),
]
JOBS = [one.job for one in SET_UPS]


def measure(runs: Mapping[str, Run], folder: Path) -> Result:
    """Times of the crack in all set-ups, scaled to the full size, and the energy that is lost."""
    rows, tips = [], [(title, job.name, _growth(runs[job.name])) for title, job in SET_UPS]
    for title, name, tip in tips:
        left, back = away(tip)
        times = [_scaled(time) for time in (left, tip.start, tip.arrest, back)]
        rows.append(
            Row("5.1", f"{title}: tip leaves its place, grows, rests, is back; "
                "energy lost", "-, 225, 334, -; 20 %, below 8 %",
                f"{', '.join(times)}; {_lost(runs[name]):.2%}", name)
        )  # fmt: skip
    figure, axes = pyplot().subplots(figsize=(6.4, 3.6))
    for time in PAPER:
        axes.axvline(time, color=SOFT, lw=0.8, ls=":")
    for (title, _, tip), colour in zip(tips, COLOURS, strict=False):
        axes.plot(QUARTER * tip.time, tip.length, color=colour, lw=1.4, label=title)
    axes.set_xlabel(f"time, times {QUARTER:g} ({unit_label('lj', 'time')})")
    axes.set_ylabel(f"length of the crack ({unit_label('lj', 'length')})")
    axes.legend(fontsize=8, frameon=True, framealpha=1.0, edgecolor="none")
    path = save(figure, folder / "images" / "growth-small-length.png")
    caption = (
        "Length of the crack at a quarter of the size; start and arrest of the paper (dotted)."
    )
    return Result("Growth of the crack: load and damping", TEXT, rows, [(path, caption)])


def _growth(run: Run) -> CrackGrowth:
    return crack_growth(run, times=[time for time in run.times if time >= FROM])


def _scaled(time: float | None) -> str:
    return shown_time(None if time is None else QUARTER * time)


def _lost(run: Run) -> float:
    """Work of the load at the end that the energy has not gained, over the work."""
    energies = run.energies
    gained = energies.energy[-1] - energies.energy[0]
    return float(1.0 - gained / energies.external_work[-1])


TEXT = """
What moves start and arrest of the crack to the paper's 225 and 334? Runs at a quarter of the size,
each with one change; all times are multiplied by 4. A damping of the whole continuum takes nearly
as much of the work by t = 360 as the paper loses. A load at once is there from t = 0 on, where ours
grows over 10 (and falls over 10 at the end); the paper does not say how its load begins.

The damped crack starts 15 to 30 later and grows by less than half as far. So the damping of the
paper cannot be why its crack starts earlier than ours: it acts the other way. Damping brings the
tip back to its first place earlier, so the paper's arrest lies between the two runs. All cracks
stop growing with the end of the load.

With a load at once the crack starts 5 earlier: a load that grows over 10 acts, once it is constant,
like one that comes at once 5 later. With the scheme of the paper in addition, the tip leaves its
place at 220 (MUSL, which feeds energy into the motion) or 233 (USL, which takes energy from it). At
full size our tip leaves its place 5 earlier than at a quarter of it, so this range is 215 to 228
there. The paper's start, at 225, lies in it. So the load and the scheme together explain it.
"""

"""Wall time of each service, stacked by phase."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from gimpmd_deploy.figures.registry import run_figure
from gimpmd_deploy.figures.style import COLOURS, pyplot, save
from gimpmd_deploy.results.run import Run
from gimpmd_deploy.results.timings import WAIT

HATCHES = ("", "///", "...")
"""A second and a third round of the colours, for further phases."""


@run_figure("wall_time")
def draw_wall_time(run: Run, folder: Path, every: bool) -> list[Path]:
    """Draw ``wall_time.png``."""
    timings = run.timings.totals()
    figure, axes = pyplot().subplots(figsize=(7.6, 1.2 + 0.9 * len(timings)))
    looks = looks_of(dict.fromkeys(phase for role in timings.values() for phase in role))
    new = set(looks)
    for row, seconds in enumerate(timings.values()):
        left = 0.0
        for phase in sorted(seconds, key=lambda name: name == WAIT):
            label = phase if phase in new else None  # one entry in the legend for each phase
            colour, hatch = looks[phase]
            bar = {"color": colour, "hatch": hatch, "edgecolor": "white", "linewidth": 0.0}
            axes.barh(row, seconds[phase], left=left, height=0.6, label=label, **bar)
            left += seconds[phase]
            new.discard(phase)
    axes.set_yticks(range(len(timings)), list(timings))
    axes.set_xlabel("wall time (s), mean over ranks")
    axes.legend(ncols=4, fontsize=9, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    return [save(figure, folder / "wall_time.png")]


def looks_of(phases: Iterable[str]) -> dict[str, tuple[str, str]]:
    """Colour and hatch of each phase, no two of them alike; only waiting is grey."""
    pairs = [(colour, hatch) for hatch in HATCHES for colour in COLOURS[:-1]]
    work = [phase for phase in phases if phase != WAIT]
    return dict(zip(work, pairs, strict=False)) | {WAIT: ("#DDDDDD", "")}

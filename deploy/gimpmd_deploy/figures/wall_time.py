"""Wall time of each service, stacked by phase."""

from __future__ import annotations

from pathlib import Path

from gimpmd_deploy.figures.registry import run_figure
from gimpmd_deploy.figures.style import COLOURS, pyplot, save
from gimpmd_deploy.results.run import Run
from gimpmd_deploy.results.timings import WAIT


@run_figure("wall_time")
def draw_wall_time(run: Run, folder: Path, every: bool) -> list[Path]:
    """Draw ``wall_time.png``."""
    timings = run.timings.totals()
    figure, axes = pyplot().subplots(figsize=(7.6, 1.2 + 0.9 * len(timings)))
    phases = list(dict.fromkeys(phase for role in timings.values() for phase in role))
    colours = dict(zip(phases, COLOURS * 3, strict=False)) | {WAIT: "#DDDDDD"}
    for row, seconds in enumerate(timings.values()):
        left = 0.0
        for phase in sorted(seconds, key=lambda name: name == WAIT):
            label = phase if phase in phases else None
            axes.barh(row, seconds[phase], left=left, height=0.6, color=colours[phase], label=label)
            left += seconds[phase]
            if label:  # one entry in the legend for each phase
                phases.remove(phase)
    axes.set_yticks(range(len(timings)), list(timings))
    axes.set_xlabel("wall time (s), mean over ranks")
    axes.legend(ncols=4, fontsize=9, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    return [save(figure, folder / "wall_time.png")]

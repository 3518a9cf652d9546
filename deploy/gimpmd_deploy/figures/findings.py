"""Marks of findings in figures: which results not to trust, and where."""

from __future__ import annotations

from gimpmd_deploy.figures.style import COLOURS, Axes
from gimpmd_deploy.results.run import Run

COLOUR = COLOURS[5]


def mark_places(axes: Axes, run: Run, time: float) -> None:
    """Mark the places of the findings made until a time, and name their kinds above the axes."""
    found = [finding for finding in run.findings if finding.time <= time]
    if not found:
        return
    kinds = ", ".join(dict.fromkeys(finding.kind for finding in found))
    axes.annotate(
        f"not reliable: {kinds} (see gimpmd report)",
        (1.0, 1.0),
        xytext=(0, 2),
        xycoords="axes fraction",
        textcoords="offset points",
        ha="right",
        va="bottom",
        color=COLOUR,
        fontsize=7,
    )
    for finding in found:
        if finding.place is not None:
            axes.plot(*finding.place[:2], "x", color=COLOUR, markersize=6, markeredgewidth=1.2)


def mark_times(axes: Axes, run: Run) -> None:
    """Mark when the findings of a run were made, on axes over time."""
    for time, kinds in _kinds_by_time(run).items():
        axes.axvline(time, color=COLOUR, lw=0.8, ls=(0, (4, 3)))
        axes.annotate(
            ", ".join(kinds),
            (time, 1.0),
            xytext=(0, 2),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            rotation=25,
            ha="left",
            va="bottom",
            color=COLOUR,
            fontsize=7,
        )


def _kinds_by_time(run: Run) -> dict[float, list[str]]:
    found: dict[float, list[str]] = {}
    for finding in run.findings:
        kinds = found.setdefault(finding.time, [])
        if finding.kind not in kinds:
            kinds.append(finding.kind)
    return found

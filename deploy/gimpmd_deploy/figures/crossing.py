"""Reflected and transmitted energy over the wavelength, from ``gimpmd verify interface``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gimpmd_deploy.figures.style import COLOURS, SOFT, Axes, pyplot, save
from gimpmd_deploy.verify.verdict import Row, Verdict


def draw_crossing(verdict: Verdict, path: Path) -> Path:
    """Draw transmitted and reflected energy over the wavelength, beside runs of one side."""
    figure, panels = pyplot().subplots(2, 2, figsize=(9, 6), sharex=True, sharey="row")
    for column, kind in enumerate("PS"):
        rows = [row for row in verdict.rows if row.polarization == kind]
        for line, share in enumerate(("transmitted", "reflected")):
            _draw_coupled(panels[line, column], rows, share)
            _draw_references(panels[line, column], rows, share)
            panels[line, column].set_xscale("log")
            panels[line, column].set_ylabel(f"{share} energy")
        panels[0, column].set_title(f"{kind} waves")
        panels[1, column].set_xlabel("wavelength / h")
        panels[1, column].set_yscale("symlog", linthresh=1e-3)
    ticks = sorted({row.wavelength for row in verdict.rows})
    panels[0, 0].set_xticks(ticks, [f"{tick:g}" for tick in ticks], minor=False)
    panels[0, 0].set_xticks([], minor=True)
    panels[0, 0].legend(fontsize=8)
    return save(figure, path)


def _draw_coupled(axes: Axes, rows: Sequence[Row], share: str) -> None:
    """Draw coupled strips: straight waves as lines, oblique waves as marks."""
    for travel, colour, label in (
        ("into", COLOURS[0], "into the atoms"),
        ("out", COLOURS[5], "out of the atoms"),
    ):
        for oblique, style in ((False, "o-"), (True, "^")):
            chosen = [r for r in rows if r.travel == travel and (r.degrees > 0.0) == oblique]
            if chosen:
                angle = f", {chosen[0].degrees:.0f} degrees" if oblique else ""
                lengths = [row.wavelength for row in chosen]
                values = [getattr(row, share) for row in chosen]
                axes.plot(lengths, values, style, color=colour, label=label + angle)


def _draw_references(axes: Axes, rows: Sequence[Row], share: str) -> None:
    """Draw strips of the continuum only and of MD only."""
    straight = [row for row in rows if row.travel == "into" and row.degrees == 0.0]
    lengths = [row.wavelength for row in straight]
    for side, colour, label in (
        ("grid", SOFT, "continuum only"),
        ("md", COLOURS[2], "MD only"),
    ):
        values = [getattr(row, f"{side}_{share}") for row in straight]
        if None not in values:
            axes.plot(lengths, values, "--", color=colour, label=label)

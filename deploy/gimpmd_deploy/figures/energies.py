"""Energies of both sides over time, and the imbalance of the whole."""

from __future__ import annotations

from pathlib import Path

from gimpmd_deploy.figures.findings import mark_times
from gimpmd_deploy.figures.registry import run_figure
from gimpmd_deploy.figures.style import COLOURS, INK, SOFT, pyplot, save, unit_label
from gimpmd_deploy.results.run import Run
from gimpmd_schemas.case.form import Role

LABELS: dict[Role, str] = {"md": "atoms", "continuum": "continuum"}
LINES: dict[Role, str] = {"md": "-", "continuum": "--"}


@run_figure("energies")
def draw_energies(run: Run, folder: Path, every: bool) -> list[Path]:
    """Draw ``energies.png``."""
    energies, style = run.energies, run.plan.units
    figure, (upper, lower) = pyplot().subplots(
        2, 1, figsize=(7.6, 6.0), sharex=True, height_ratios=[3, 1]
    )
    for role, side in energies.sides.items():
        for colour, kind in zip(COLOURS, ("kinetic", "potential"), strict=False):
            label = f"{kind}, {LABELS[role]}"
            values = getattr(side, kind)
            upper.plot(energies.time, values, LINES[role], color=colour, lw=1.4, label=label)
    upper.plot(energies.time, energies.energy, color=INK, lw=2.0, label="total")
    upper.plot(
        energies.time, energies.external_work, ":", color=COLOURS[5], lw=1.4, label="external work"
    )
    if energies.fix_work.any():
        upper.plot(
            energies.time, energies.fix_work, "-.", color=COLOURS[2], lw=1.4, label="work of fixes"
        )
    upper.set_ylabel(f"energy ({unit_label(style, 'energy')})")
    upper.legend(ncols=2, fontsize=9)
    mark_times(upper, run)
    scale = energies.scale()
    lower.axhline(0.0, color=SOFT, lw=0.6)
    lower.plot(
        energies.time, 100.0 * energies.imbalance() / (scale.value or 1.0), color=INK, lw=1.4
    )
    lower.set_ylabel(f"imbalance\n(% of {scale.name})")
    lower.set_xlabel(f"time ({unit_label(style, 'time')})")
    return [save(figure, folder / "energies.png")]

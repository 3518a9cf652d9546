"""Stress of both sides in one figure: the whole body, and windows in which atoms can be seen.

In three dimensions it is a slice through the middle of the body, in the plane of constant z.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from gimpmd_deploy.figures.body import frame, outline, rectangle
from gimpmd_deploy.figures.particles import draw_discs, draw_particles, in_slice
from gimpmd_deploy.figures.registry import run_figure
from gimpmd_deploy.figures.style import INK, SOFT, Axes, Figure, save, unit_label
from gimpmd_deploy.figures.windows import Window, inside, make_layout, windows_of
from gimpmd_deploy.results.particles import Particles
from gimpmd_deploy.results.run import Run
from gimpmd_schemas.case.plan import Plan

MANY = 12
"""Largest number of figures over time, unless all are asked for."""


@run_figure("sigma_yy")
def draw_stresses(run: Run, folder: Path, every: bool) -> list[Path]:
    """Draw ``sigma_yy.png`` at the last output, and ``sigma_yy_NNNN.png`` over time."""
    times = run.times
    limit = _limit(*_parts(run, times[-1])[:2])
    chosen = range(len(times))
    if not every and len(times) > MANY:
        chosen = np.unique(np.linspace(0, len(times) - 1, MANY).round().astype(int)).tolist()
    drawn = [
        _draw_stress(run, times[index], limit, folder / f"sigma_yy_{index:04d}.png")
        for index in chosen
    ]
    return [_draw_stress(run, times[-1], limit, folder / "sigma_yy.png"), *drawn]


def _limit(*sets: Particles | None) -> float:
    """End of a symmetric colour scale; the largest hundredth of the stresses lies beyond it."""
    stress = np.concatenate([np.abs(p.stress[:, 1]) for p in sets if p is not None] + [[]])
    return (float(np.percentile(stress, 99.0)) if stress.size else 0.0) or 1.0


def _draw_stress(run: Run, time: float, limit: float, path: Path) -> Path:
    plan = run.plan
    points, atoms, ghosts = _parts(run, time)
    windows = windows_of(plan, atoms)
    layout = make_layout(plan.domain.box, len(windows))
    colours = draw_particles(layout.whole, points, atoms, limit, cover=True)
    outline(layout.whole, plan)
    frame(layout.whole, plan.domain.box, unit_label(plan.units, "length"))
    layout.whole.set_title(_title(plan, time), loc="left")
    for letter, (name, window), axes in zip("abc", windows, layout.details, strict=False):
        near = [inside(particles, window) for particles in (points, atoms, ghosts)]
        own = limit if name == "interface" else _limit(near[0], near[1])
        shades = draw_particles(axes, near[0], near[1], own, cover=False)
        draw_discs(axes, near[2], facecolors="none", edgecolors=SOFT, linewidths=0.4)
        outline(axes, plan)
        frame(axes, window)
        if own != limit:
            inset = axes.inset_axes((1.03, 0.0, 0.04, 1.0))
            _colour_bar(layout.figure, shades, inset, "vertical")
        axes.set_title(f"$\\bf{{{letter}}}$  {name}", fontsize=10, loc="left")
        _mark(layout.whole, window, letter)
    bar = _colour_bar(layout.figure, colours, layout.bar, "horizontal")
    bar.set_label(f"$\\sigma_{{yy}}$ ({unit_label(plan.units, 'pressure', plan.dim)})")
    return save(layout.figure, path)


def _title(plan: Plan, time: float) -> str:
    title = f"$\\sigma_{{yy}}$ at t = {time:.4g} {unit_label(plan.units, 'time')}"
    if plan.dim == 3:
        title += f", slice at z = {_middle(plan):.4g} {unit_label(plan.units, 'length')}"
    return title


def _middle(plan: Plan) -> float:
    """Height of the slice: the middle of the body along z; unused in two dimensions."""
    low, high = plan.domain.box[-1]
    return 0.5 * (low + high)


def _parts(run: Run, time: float) -> tuple[Particles | None, Particles | None, Particles | None]:
    """Points outside the inner zone, free atoms, and atoms that follow the grid.

    Particles that follow the other side would show its stress twice, and atoms at the edge of the
    region lack half of their neighbours.
    """
    found = {role: in_slice(p, _middle(run.plan)) for role, p in run.particles(time).items()}
    points, atoms = found.get("continuum"), found.get("md")
    if run.plan.coupling is None or points is None or atoms is None:
        return points, atoms, None
    zones = run.plan.coupling.zones
    free = zones.depth(atoms.reference) >= zones.outer
    own = zones.depth(points.reference) < zones.energy_plane
    return points.where(own), atoms.where(free), atoms.where(~free)


def _colour_bar(figure: Figure, colours: Any, axes: Axes, orientation: str) -> Any:
    bar = figure.colorbar(colours, cax=axes, orientation=orientation, extend="both")
    bar.outline.set_visible(False)
    return bar


def _mark(axes: Axes, window: Window, letter: str) -> None:
    """Show on the whole body where a window lies."""
    rectangle(axes, window, edgecolor=INK, linewidth=0.8, linestyle=(0, (2, 2)))
    axes.annotate(
        letter,
        (window[0][0], window[1][1]),
        xytext=(2, 2),
        textcoords="offset points",
        weight="bold",
        fontsize=9,
    )

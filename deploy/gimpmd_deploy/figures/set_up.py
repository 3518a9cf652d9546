"""The set-up of a case before it runs."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gimpmd_deploy.figures.body import ZONE_COLOURS, frame, rectangle, zone_outlines
from gimpmd_deploy.figures.style import COLOURS, FAINT, INK, SOFT, Axes, pyplot, save, unit_label
from gimpmd_schemas.case.derive import levels, regions
from gimpmd_schemas.case.derive.zones import zones
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.profiles import components
from gimpmd_schemas.grid.zones import Box, MdRegion, patches


def draw_set_up(case: Case, path: Path) -> Path:
    """Draw body, levels, MD regions, zones, patches and conditions of a case.

    A body of three dimensions is seen along z, which the title says.
    """
    (x0, x1), (y0, y1) = case.domain.box[:2]
    ratio = float(np.clip((y1 - y0) / (x1 - x0), 0.25, 2.0))
    figure, axes = pyplot().subplots(figsize=(7.6, 6.6 * ratio + 1.2))
    for k, (h, boxes) in enumerate(zip(levels.cells(case), levels.boxes(case), strict=True)):
        for box in boxes:
            _draw_cells(axes, box, h)
            if k:
                rectangle(axes, box, edgecolor=SOFT, linewidth=0.8)
        axes.plot([], [], color=FAINT, label=f"level {k}, h = {h:g}")
    rectangle(axes, case.domain.box, edgecolor=INK, linewidth=1.2, label="domain")
    if case.only is None:
        for number, (box, region) in enumerate(
            zip(regions.md_regions(case), zones(case).regions, strict=True)
        ):
            _draw_zones(axes, case, box, region, labelled=number == 0)
    if case.only != "continuum":
        _draw_patches(axes, case)
    for crack in case.continuum.cracks:
        x, y, *_ = zip(*crack.corners(), crack.start, strict=True)
        axes.plot(x, y, color=COLOURS[5], lw=2.0, label="crack")
    _draw_loads(axes, case)
    frame(axes, case.domain.box, unit_label(case.units, "length"))
    if case.dim == 3:
        axes.set_title("seen along z", loc="left")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.06), ncols=3, fontsize=9)
    return save(figure, path)


def _draw_patches(axes: Axes, case: Case) -> None:
    """Draw the patches of the MD ranks."""
    for patch in patches(regions.md_region(case), regions.md_patches(case)):
        rectangle(axes, patch, edgecolor=COLOURS[0], linewidth=0.8, linestyle=":")
    label = f"{case.atoms.ranks} MD patches" if case.atoms.ranks > 1 else "1 MD patch"
    axes.plot([], [], ":", color=COLOURS[0], label=label)


def _draw_cells(axes: Axes, box: Box, h: float) -> None:
    """Draw the lines between the cells of a box."""
    (x0, x1), (y0, y1) = box[:2]
    style = {"color": FAINT, "lw": 0.5, "zorder": 0}
    axes.vlines(np.arange(x0, x1 + 0.5 * h, h), y0, y1, **style)
    axes.hlines(np.arange(y0, y1 + 0.5 * h, h), x0, x1, **style)


def _draw_zones(axes: Axes, case: Case, region_box: Box, region: MdRegion, labelled: bool) -> None:
    """Draw the zones of a region as coloured frames, from outside in."""
    from matplotlib.patches import Rectangle

    edge = region_box
    for name, inner in zone_outlines(case.coupling.scheme, zones(case), region):
        (x0, x1), (y0, y1) = edge[:2]
        colour, label = ZONE_COLOURS[name], f"{name} zone" if labelled else None
        axes.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, facecolor=colour, lw=0, label=label))
        edge = inner
    (x0, x1), (y0, y1) = edge[:2]
    axes.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, facecolor="white", lw=0))
    label = "MD region" if labelled else None
    rectangle(axes, region_box, edgecolor=INK, linewidth=1.2, label=label)


def _draw_loads(axes: Axes, case: Case) -> None:
    """Write the condition of each loaded face beside it; faces of z are not shown."""
    (x0, x1), (y0, y1) = case.domain.box[:2]
    ends = ((x0, x1), (y0, y1))
    offsets = {(0, 0): (8, 0, 90), (0, 1): (-8, 0, 90), (1, 0): (0, 6, 0), (1, 1): (0, 6, 0)}
    parts = [
        (axis, side, face)
        for axis, side in offsets
        for face in case.boundary.parts(axis, side).values()
    ]
    for axis, side, face in parts:
        if face.condition == "free":
            continue
        dx, dy, turn = offsets[axis, side]
        middle = 0.5 * sum(face.extent[0] if face.extent else ends[1 - axis])
        x, y = (ends[0][side], middle) if axis == 0 else (middle, ends[1][side])
        entries = ["-" if v is None else f"{v:g}" for v in components(face.value)]
        value = f" ({', '.join(entries)})" if entries else ""
        if not isinstance(face.value, tuple):
            value = f" ({face.value.__struct_config__.tag})"
        ramp = f", ramp {face.ramp:g}" if face.ramp else ", history" if face.history else ""
        axes.annotate(
            f"{face.condition}{value}{ramp}",
            (x, y),
            xytext=(dx, dy),
            textcoords="offset points",
            rotation=turn,
            ha="center",
            va="center" if axis == 0 else "bottom",
            color=COLOURS[5],
            fontsize=9,
            annotation_clip=False,
        )

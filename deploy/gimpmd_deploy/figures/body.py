"""Parts of a body in the x-y plane: boxes, zones, and their outlines.

A body of three dimensions is seen along z.
"""

from __future__ import annotations

from typing import Any

from gimpmd_deploy.figures.style import INK, SOFT, Axes, Figure
from gimpmd_schemas.case.form import AT_PLANES
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.grid.zones import Box, MdRegion, Zones, cut

WIDE = 7.0
"""Least width in inches of a figure whose legend has three columns."""

ZONE_COLOURS = {
    "outer": "#009E73",
    "incommunicado": "#E69F00",
    "inner": "#CC79A7",
    "ghost": "#009E73",
}


def frame(axes: Axes, box: Box, unit: str = "", margin: bool = True) -> None:
    """Limit axes to a box, with equal scales and a margin; with ``unit``, label them."""
    gap = 0.01 * max(box[0][1] - box[0][0], box[1][1] - box[1][0]) if margin else 0.0
    axes.set_xlim(box[0][0] - gap, box[0][1] + gap)
    axes.set_ylim(box[1][0] - gap, box[1][1] + gap)
    axes.set_aspect("equal")
    axes.apply_aspect()  # so that the size of a pixel is known before anything is drawn
    if unit:
        axes.set_xlabel(f"x ({unit})")
        axes.set_ylabel(f"y ({unit})")


def rectangle(axes: Axes, box: Box, **style: Any) -> None:
    """Draw the outline of a box in the x-y plane."""
    from matplotlib.patches import Rectangle

    (x0, x1), (y0, y1) = box[:2]
    axes.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, fill=False, **style))


def zone_outlines(scheme: str, zones: Zones, region: MdRegion) -> list[tuple[str, Box]]:
    """Return the inner edge of each zone of a region, as a box, with the name of the zone."""
    edges = [("outer", zones.outer), ("incommunicado", zones.handover), ("inner", zones.innermost)]
    if scheme in AT_PLANES:
        edges = [("ghost", zones.outer)]
    return [(name, cut(region.box, region.within(depth))) for name, depth in edges]


def outline(axes: Axes, plan: Plan, with_zones: bool = True) -> None:
    """Draw the outlines of body, levels and MD regions, and the lines between zones."""
    rectangle(axes, plan.domain.box, edgecolor=SOFT, linewidth=0.8)
    if plan.only != "md":
        for boxes in plan.level_boxes[1:]:
            for box in boxes:
                rectangle(axes, box, edgecolor=SOFT, linewidth=0.6, linestyle="--")
    if plan.coupling is None:
        return
    zones = plan.coupling.zones
    for region_box, region in zip(plan.atoms.regions, zones.regions, strict=True):
        rectangle(axes, region_box, edgecolor=INK, linewidth=1.0)
        for name, box in zone_outlines(plan.coupling.scheme, zones, region) if with_zones else ():
            _interface_lines(axes, box, region, ZONE_COLOURS[name])


def legend(figure: Figure, plan: Plan, with_zones: bool = True) -> None:
    """Say at the foot of a figure what the lines of `outline` are."""
    from matplotlib.lines import Line2D

    lines = []
    if plan.only != "md" and len(plan.level_boxes) > 1:
        lines.append(Line2D([], [], color=SOFT, lw=0.6, ls="--", label="finer grid"))
    if plan.coupling is not None:
        lines.append(Line2D([], [], color=INK, lw=1.0, label="MD region"))
        zones = plan.coupling.zones
        edges = zone_outlines(plan.coupling.scheme, zones, zones.regions[0]) if with_zones else ()
        for name, _ in edges:
            label = f"inner edge of the {name} zone"
            lines.append(Line2D([], [], color=ZONE_COLOURS[name], lw=0.9, label=label))
    if lines:
        columns = 3 if figure.get_figwidth() > WIDE else 2
        figure.legend(handles=lines, loc="lower center", ncols=columns, fontsize=8)


def _interface_lines(axes: Axes, box: Box, region: MdRegion, colour: str) -> None:
    """Draw the sides of a box that belong to interfaces, in the x-y plane."""
    for axis, sides in enumerate(region.interfaces[:2]):
        for side, is_interface in enumerate(sides):
            if is_interface:
                line = [list(box[0]), list(box[1])]
                line[axis] = [box[axis][side]] * 2
                axes.plot(*line, color=colour, lw=0.9)

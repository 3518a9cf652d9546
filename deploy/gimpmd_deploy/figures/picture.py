"""One figure of a field: the whole body, and windows in which atoms can be seen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gimpmd_deploy.figures.body import frame, legend, outline, rectangle
from gimpmd_deploy.figures.colours import Scale
from gimpmd_deploy.figures.findings import mark_places
from gimpmd_deploy.figures.particles import draw_atoms, draw_points, draw_rings
from gimpmd_deploy.figures.shown import Shown, middle
from gimpmd_deploy.figures.style import DPI, INK, Axes, Figure, unit_label
from gimpmd_deploy.figures.windows import INTERFACE, Window, inside, make_layout, windows_of
from gimpmd_deploy.results.fields import describe
from gimpmd_deploy.results.run import Run
from gimpmd_schemas.case.plan import Plan


@dataclass(frozen=True)
class Look:
    """What the figures of a field share over time.

    Attributes
    ----------
    name : the field.
    box : what the axes of the body show, in the x-y plane.
    scale : colours of the body.
    close : colours of windows by name; other windows have those of the body.
    windows : names of the windows that may be drawn; none if the axes show a part of the body.
    """

    name: str
    box: Window
    scale: Scale
    close: dict[str, Scale]
    windows: tuple[str, ...]


def draw_picture(run: Run, shown: Shown, look: Look, dpi: int = DPI) -> Figure:
    """Draw a field at one time, with so many pixels per inch."""
    plan, name = run.plan, look.name
    found = windows_of(run, shown, name) if look.windows else {}
    windows = {key: window for key, window in found.items() if key in look.windows}
    layout = make_layout(look.box, len(windows), dpi)
    _draw_window(layout.whole, plan, shown, name, look.scale, look.box, whole=bool(look.windows))
    layout.whole.set_xlabel(f"x ({unit_label(plan.units, 'length')})")
    layout.whole.set_ylabel(f"y ({unit_label(plan.units, 'length')})")
    layout.whole.set_title(_title(plan, shown.time, name), loc="left")
    mark_places(layout.whole, run, shown.time)
    for letter, (key, window), axes in zip("ab", windows.items(), layout.details, strict=False):
        scale = look.close.get(key, look.scale)
        _draw_window(axes, plan, shown, name, scale, window)
        axes.set_title(f"$\\mathbf{{{letter}}}$  {key}", loc="left", fontsize=10)
        if key in look.close:
            _colour_bar(layout.figure, scale, axes.inset_axes((1.03, 0.0, 0.045, 1.0)), "vertical")
        _mark(layout.whole, window, letter)
    bar = _colour_bar(layout.figure, look.scale, layout.bar, "horizontal")
    bar.set_label(_label(plan, name))
    legend(layout.figure, plan, with_zones=INTERFACE in windows or not look.windows)
    return layout.figure


def _draw_window(
    axes: Axes,
    plan: Plan,
    shown: Shown,
    name: str,
    scale: Scale,
    window: Window,
    whole: bool = False,
) -> None:
    """Draw the particles in a window, and outlines over them; zones only show close up."""
    frame(axes, window, margin=whole)
    points, atoms, followers = (
        inside(p, (axes.get_xlim(), axes.get_ylim()))
        for p in (shown.points, shown.atoms, shown.followers)
    )
    draw_points(axes, points, name, scale)
    draw_atoms(axes, atoms, name, scale)
    draw_rings(axes, followers)
    outline(axes, plan, with_zones=not whole)


def _title(plan: Plan, time: float, name: str) -> str:
    symbol = describe(name).symbol
    title = f"{symbol[:1].upper() + symbol[1:]}, $t$ = {time:.4g} {unit_label(plan.units, 'time')}"
    if plan.dim == 3:
        title += f", slice at $z$ = {middle(plan):.4g} {unit_label(plan.units, 'length')}"
    return title


def _label(plan: Plan, name: str) -> str:
    field = describe(name)
    if not field.quantity:
        return field.symbol
    return f"{field.symbol} ({unit_label(plan.units, field.quantity, plan.dim)})"


def _colour_bar(figure: Figure, scale: Scale, axes: Axes, orientation: str) -> Any:
    bar = figure.colorbar(scale.colours(), cax=axes, orientation=orientation, extend="both")
    bar.outline.set_visible(False)
    bar.formatter.set_powerlimits((-2, 3))  # long numbers would not fit beside a window
    return bar


def _mark(axes: Axes, window: Window, letter: str) -> None:
    """Show on the whole body where a window lies."""
    from matplotlib.patheffects import withStroke

    halo = [withStroke(linewidth=2.0, foreground="white")]  # on dark colours
    style = {"edgecolor": INK, "linewidth": 0.8, "linestyle": (0, (2, 2)), "path_effects": halo}
    rectangle(axes, window, **style)
    axes.annotate(
        letter,
        (window[0][0], window[1][1]),
        xytext=(2, 2),
        textcoords="offset points",
        weight="bold",
        fontsize=9,
        path_effects=halo,
    )

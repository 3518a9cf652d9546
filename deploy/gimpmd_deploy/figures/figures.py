"""Pictures of a run: stress of both sides in one, energies, where the time went, the set-up."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gimpmd_deploy.results.reading import Particles, Run, Series
from gimpmd_deploy.verify.verify import Verdict
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.zones import Box, MdRegion, Zones, patches
from gimpmd_schemas.mechanics.units import UNITS

INK, SOFT = "#222222", "#777777"
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#F0E442", "#999999")
"""Okabe and Ito's colours, which colour-blind readers tell apart."""

ZONE_COLOURS = {
    "outer": "#009E73",
    "incommunicado": "#E69F00",
    "inner": "#CC79A7",
    "ghost": "#009E73",
}
STRESS_MAP = "RdBu_r"
MANY = 12
"""Pictures of the stress over time that a run draws by itself, at most."""

Axes = Any
Figure = Any


def _pyplot() -> Any:
    try:
        import matplotlib
    except ImportError:
        raise BackendError("figures need matplotlib: pip install 'gimpmd[viz]'") from None
    matplotlib.use("Agg")
    from matplotlib import pyplot

    pyplot.rcParams.update(
        {
            "font.size": 10,
            "axes.edgecolor": SOFT,
            "axes.labelcolor": INK,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "xtick.color": SOFT,
            "ytick.color": SOFT,
            "legend.frameon": False,
            "figure.constrained_layout.use": True,
        }
    )
    return pyplot


def draw_all(run: Run, every: bool = False) -> list[Path]:
    """Draw all figures of a run into its ``figures/``.

    Parameters
    ----------
    every : draw the stress at every output, not at most a dozen of them.

    Raises
    ------
    BackendError
        Matplotlib is not installed.
    InputError
        The run wrote no output.
    """
    folder = run.folder / "figures"
    folder.mkdir(exist_ok=True)
    drawn = draw_stresses(run, folder, every)
    drawn.append(draw_energies(run.series, run.case, folder / "energies.png"))
    drawn.append(draw_wall_time(run.series, folder / "wall_time.png"))
    return drawn


def _save(figure: Figure, path: Path) -> Path:
    figure.savefig(path, dpi=160)
    _pyplot().close(figure)
    return path


def draw_stresses(run: Run, folder: Path, every: bool) -> list[Path]:
    """``sigma_yy.png`` of the last output, and ``sigma_yy_NNNN.png`` over time."""
    times = run.times()
    case, last = run.case, times[-1]
    limit = _limit(*_parts(case, run.points_at(last), run.atoms_at(last))[:2])
    chosen = range(len(times))
    if not every and len(times) > MANY:
        chosen = np.unique(np.linspace(0, len(times) - 1, MANY).round().astype(int)).tolist()
    drawn = [
        _draw_stress(run, times[index], limit, folder / f"sigma_yy_{index:04d}.png")
        for index in chosen
    ]
    return [_draw_stress(run, times[-1], limit, folder / "sigma_yy.png"), *drawn]


def _limit(*sets: Particles | None) -> float:
    """End of a symmetric colour scale that a few extreme values do not stretch."""
    stress = np.concatenate([np.abs(p.stress[:, 1]) for p in sets if p is not None] + [[]])
    return (float(np.percentile(stress, 99.0)) if stress.size else 0.0) or 1.0


def _draw_stress(run: Run, time: float, limit: float, path: Path) -> Path:
    """One picture: the whole body, and windows in which atoms can be seen."""
    case = run.case
    points, atoms, held = _parts(case, run.points_at(time), run.atoms_at(time))
    windows = _windows(case, atoms)
    layout = _layout(case, len(windows))
    colours = _draw_particles(layout.whole, points, atoms, limit, cover=True)
    _outline(layout.whole, case)
    _frame(layout.whole, case.domain.box, _unit(case, "length"))
    title = f"$\\sigma_{{yy}}$ at t = {time:.4g} {_unit(case, 'time')}"
    layout.whole.set_title(title, loc="left")
    for letter, (name, window), axes in zip("abc", windows, layout.details, strict=False):
        near = [_inside(particles, window) for particles in (points, atoms, held)]
        own = limit if name == "interface" else _limit(near[0], near[1])
        shades = _draw_particles(axes, near[0], near[1], own, cover=False)
        _draw_discs(axes, near[2], facecolors="none", edgecolors=SOFT, linewidths=0.4)
        _outline(axes, case)
        _frame(axes, window)
        if own != limit:
            inset = axes.inset_axes((1.03, 0.0, 0.04, 1.0))
            _colour_bar(layout.figure, shades, inset, "vertical")
        axes.set_title(f"$\\bf{{{letter}}}$  {name}", fontsize=10, loc="left")
        _mark(layout.whole, window, letter)
    bar = _colour_bar(layout.figure, colours, layout.bar, "horizontal")
    bar.set_label(f"$\\sigma_{{yy}}$ ({_unit(case, 'pressure')})")
    return _save(layout.figure, path)


def _colour_bar(figure: Figure, colours: Any, axes: Axes, orientation: str) -> Any:
    bar = figure.colorbar(colours, cax=axes, orientation=orientation, extend="both")
    bar.outline.set_visible(False)
    return bar


def _parts(
    case: Case, points: Particles | None, atoms: Particles | None
) -> tuple[Particles | None, Particles | None, Particles | None]:
    """Points outside the inner zone, free atoms, and atoms that follow the grid.

    What follows the other side would only show its stress twice; and atoms at the rim of the
    region lack half of their neighbours.
    """
    if case.only is not None or points is None or atoms is None:
        return points, atoms, None
    zones = case.zones()
    depth = zones.depth(atoms.site)
    free = depth >= zones.outer
    held = zones.depth(points.site) < zones.energy_plane
    return points.where(held), atoms.where(free), atoms.where(~free)


@dataclass(frozen=True)
class _Layout:
    """Axes for the whole body, square windows beside it (below if it is wide), a colour bar.

    Placed by hand: automatic layouts clip labels or shrink axes of a fixed aspect.
    """

    figure: Figure
    whole: Axes
    details: list[Axes]
    bar: Axes


def _layout(case: Case, windows: int) -> _Layout:
    (x0, x1), (y0, y1) = case.domain.box[:2]
    ratio = float(np.clip((y1 - y0) / (x1 - x0), 0.15, 3.0))
    width = 6.4 if ratio < 1.5 else 4.2
    height, left, bottom, gap, top = width * ratio, 0.85, 1.45, 0.55, 0.45
    beside = ratio >= 0.75
    gap = gap if beside else 1.25  # a window's own colour bar stands in it
    side = (height - gap) / 2 if beside else (width - gap) / 2
    below = side + 0.8 if windows and not beside else 0.0
    right = side + gap + 0.75 if windows and beside else 0.25
    size = (left + width + right, bottom + below + height + top)
    figure = _pyplot().figure(figsize=size, layout="none")

    def place(x: float, y: float, w: float, h: float) -> Axes:
        return figure.add_axes((x / size[0], y / size[1], w / size[0], h / size[1]))

    corner = bottom + below
    whole = place(left, corner, width, height)
    details = []
    for index in range(windows):
        if beside:
            y = corner + (1 - index) * (side + gap)
            details.append(place(left + width + gap, y, side, side))
        else:
            details.append(place(left + index * (side + gap), bottom - 0.25, side, side))
    return _Layout(figure, whole, details, place(left + 0.15 * width, 0.62, 0.7 * width, 0.13))


def _unit(case: Case, quantity: str) -> str:
    """Unit of a quantity as a label writes it."""
    unit = str(getattr(UNITS[case.units], quantity)).replace("^d", "$^2$")
    for name in ("sigma", "tau", "epsilon"):
        unit = unit.replace(name, f"$\\{name}$")
    return unit


def _windows(case: Case, atoms: Particles | None) -> list[tuple[str, tuple[Any, Any]]]:
    """Where to look closer: the crack tip or most stressed spot, and the interface."""
    if atoms is None or not atoms.x.size:
        return []
    zones = case.zones()
    half = 18.0 * float(atoms.size[0, 0])
    windows = []
    if case.continuum.cracks:
        tip = np.array(case.continuum.cracks[0].end)
        windows.append(("crack tip", _window(tip, half)))
    else:
        faces = np.array(case.domain.box)
        rim = np.minimum(atoms.site - faces[:, 0], faces[:, 1] - atoms.site).min(axis=1)
        deep = atoms.where((rim > 0.25 * half) & (zones.depth(atoms.site) > zones.handover))
        if deep.x.size:
            hot = deep.x[np.argmax(np.abs(deep.stress[:, 1]))]
            windows.append(("largest stress", _window(hot, half)))
    if case.only is None:
        half = max(0.9 * zones.innermost, 2.0 * case.finest_cell())
        windows.append(("interface", _window(_interface(zones), half)))
    return windows


def _interface(zones: Zones) -> Floats:
    """A place in the zones of the first region: a corner, or the middle of an interface."""
    region = zones.regions[0]
    place = [0.5 * (low + high) for low, high in region.box]
    for axis, (low, high) in enumerate(region.interfaces):
        if high or low:
            face = region.box[axis][1] if high else region.box[axis][0]
            place[axis] = face + (-0.5 if high else 0.5) * zones.innermost
    return np.array(place)


def _window(centre: Floats, half: float) -> tuple[Any, Any]:
    return (
        (centre[0] - half, centre[0] + half),
        (centre[1] - half, centre[1] + half),
    )


def _inside(particles: Particles | None, window: tuple[Any, Any]) -> Particles | None:
    if particles is None:
        return None
    near = np.ones(particles.x.shape[0], dtype=np.bool_)
    for axis, (low, high) in enumerate(window):
        reach = particles.size[:, axis]
        near &= (particles.x[:, axis] > low - reach) & (particles.x[:, axis] < high + reach)
    return particles.where(near)


def _draw_particles(
    axes: Axes, points: Particles | None, atoms: Particles | None, limit: float, cover: bool
) -> Any:
    """Points as squares of their size and atoms as discs of theirs, in data units.

    Parameters
    ----------
    cover : let them overlap so far that no paper shines through.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import Normalize

    norm = Normalize(-limit, limit)
    if points is not None:
        corners = (0.53 if cover else 0.5) * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        squares = points.x[:, None, :] + points.size[:, None, :] * corners
        axes.add_collection(
            PolyCollection(
                list(squares),
                array=points.stress[:, 1],
                cmap=STRESS_MAP,
                norm=norm,
                linewidths=0.0 if cover else 0.3,
                edgecolors="face" if cover else SOFT,
                antialiaseds=not cover,
                rasterized=True,
            )
        )
    style = {"linewidths": 0.0, "edgecolors": "face"} if cover else {"linewidths": 0.3}
    _draw_discs(
        axes,
        atoms,
        1.16 if cover else 0.96,
        array=None if atoms is None else atoms.stress[:, 1],
        cmap=STRESS_MAP,
        norm=norm,
        **({"edgecolors": INK} | style),
    )
    return ScalarMappable(norm, STRESS_MAP)


def _draw_discs(axes: Axes, atoms: Particles | None, scale: float = 0.96, **style: Any) -> None:
    """Atoms as discs in data units."""
    from matplotlib.collections import EllipseCollection

    if atoms is None:
        return
    width = scale * atoms.size[:, 0]
    axes.add_collection(
        EllipseCollection(
            width,
            width,
            np.zeros(width.size),
            units="xy",
            offsets=atoms.x,
            offset_transform=axes.transData,
            rasterized=True,
            **style,
        )
    )


def _frame(axes: Axes, box: Box, unit: str = "") -> None:
    margin = 0.01 * max(box[0][1] - box[0][0], box[1][1] - box[1][0])
    axes.set_xlim(box[0][0] - margin, box[0][1] + margin)
    axes.set_ylim(box[1][0] - margin, box[1][1] + margin)
    axes.set_aspect("equal")
    if unit:
        axes.set_xlabel(f"x ({unit})")
        axes.set_ylabel(f"y ({unit})")


def _rectangle(axes: Axes, box: Box, **style: Any) -> None:
    from matplotlib.patches import Rectangle

    (x0, x1), (y0, y1) = box[:2]
    axes.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, fill=False, **style))


def _mark(axes: Axes, window: tuple[Any, Any], letter: str) -> None:
    """Show on the whole picture where a window lies."""
    _rectangle(axes, window, edgecolor=INK, linewidth=0.8, linestyle=(0, (2, 2)))
    axes.annotate(
        letter,
        (window[0][0], window[1][1]),
        xytext=(2, 2),
        textcoords="offset points",
        weight="bold",
        fontsize=9,
    )


def zone_outlines(case: Case, region: MdRegion) -> list[tuple[str, tuple[Any, Any]]]:
    """Inner edge of each zone of a region as a box clipped to it, by the zone's name."""
    zones = case.zones()
    edges = [("outer", zones.outer), ("incommunicado", zones.handover), ("inner", zones.innermost)]
    if case.coupling.scheme == "force":
        edges = [("ghost", zones.outer)]
    outlines = []
    for name, depth in edges:
        box = [
            (max(low, r0), min(high, r1))
            for (low, high), (r0, r1) in zip(region.within(depth), region.box, strict=True)
        ]
        outlines.append((name, (box[0], box[1])))
    return outlines


def _outline(axes: Axes, case: Case) -> None:
    """Lines around body and MD regions, and where one zone ends and the next begins."""
    _rectangle(axes, case.domain.box, edgecolor=SOFT, linewidth=0.8)
    if case.only != "md":
        for boxes in case.level_boxes()[1:]:
            for box in boxes:
                _rectangle(axes, box, edgecolor=SOFT, linewidth=0.6, linestyle="--")
    if case.only is not None:
        return
    for rim, region in zip(case.md_regions(), case.zones().regions, strict=True):
        _rectangle(axes, rim, edgecolor=INK, linewidth=1.0)
        for name, box in zone_outlines(case, region):
            for axis, sides in enumerate(region.interfaces):
                for side, is_interface in enumerate(sides):
                    if is_interface:
                        line = [list(box[0]), list(box[1])]
                        line[axis] = [box[axis][side]] * 2
                        axes.plot(*line, color=ZONE_COLOURS[name], lw=0.9)


def draw_energies(series: Series, case: Case, path: Path) -> Path:
    """Energies of both sides over time, and how far their sum is from the work done."""
    pyplot = _pyplot()
    figure, (upper, lower) = pyplot.subplots(
        2, 1, figsize=(7.6, 6.0), sharex=True, height_ratios=[3, 1]
    )
    names = {"md": "atoms", "continuum": "continuum"}
    for role, style in (("md", "-"), ("continuum", "--")):
        if role in series.sides:
            for colour, kind in zip(COLOURS, ("kinetic", "potential"), strict=False):
                values = series.sides[role][kind]
                upper.plot(
                    series.time, values, style, color=colour, lw=1.4, label=f"{kind}, {names[role]}"
                )
    upper.plot(series.time, series.energy, color=INK, lw=2.0, label="total")
    upper.plot(series.time, series.work, color=COLOURS[5], lw=1.4, ls=":", label="external work")
    upper.set_ylabel(f"energy ({_unit(case, 'energy')})")
    upper.legend(ncols=2, fontsize=9)
    lower.axhline(0.0, color=SOFT, lw=0.6)
    lower.plot(series.time, 100.0 * series.missing() / (series.scale() or 1.0), color=INK, lw=1.4)
    lower.set_ylabel("missing energy\n(% of largest)")
    lower.set_xlabel(f"time ({_unit(case, 'time')})")
    return _save(figure, path)


def draw_wall_time(series: Series, path: Path) -> Path:
    """What each service did with its wall time, stacked by phase."""
    pyplot = _pyplot()
    figure, axes = pyplot.subplots(figsize=(7.6, 1.2 + 0.9 * len(series.timings)))
    phases = list(dict.fromkeys(p for role in series.timings.values() for p in role))
    colours = dict(zip(phases, COLOURS * 3, strict=False)) | {"wait": "#DDDDDD"}
    for row, seconds in enumerate(series.timings.values()):
        left = 0.0
        for phase in sorted(seconds, key=lambda name: name == "wait"):
            width = float(seconds[phase].sum())
            label = phase if phase in phases else None
            axes.barh(row, width, left=left, height=0.6, color=colours[phase], label=label)
            left += width
            if label:
                phases.remove(phase)
    axes.set_yticks(range(len(series.timings)), list(series.timings))
    axes.set_xlabel("wall time (s), mean over ranks")
    axes.legend(ncols=4, fontsize=9, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    return _save(figure, path)


def draw_setup(case: Case, path: Path) -> Path:
    """The set-up without a run: body, levels, MD region, zones, patches and conditions.

    A body of three dimensions is seen along z.
    """
    pyplot = _pyplot()
    (x0, x1), (y0, y1) = case.domain.box[:2]
    ratio = float(np.clip((y1 - y0) / (x1 - x0), 0.25, 2.0))
    figure, axes = pyplot.subplots(figsize=(7.6, 6.6 * ratio + 1.2))
    for k, (h, boxes) in enumerate(zip(case.level_cells(), case.level_boxes(), strict=True)):
        for box in boxes:
            _draw_cells(axes, box, h)
            if k:
                _rectangle(axes, box, edgecolor=SOFT, linewidth=0.8)
        axes.plot([], [], color="#E4E4E4", label=f"level {k}, h = {h:g}")
    _rectangle(axes, case.domain.box, edgecolor=INK, linewidth=1.2, label="domain")
    if case.only is None:
        for number, (box, region) in enumerate(
            zip(case.md_regions(), case.zones().regions, strict=True)
        ):
            _draw_zones(axes, case, box, region, labelled=number == 0)
    if case.only != "continuum":
        for patch in patches(case.md_region(), case.md_patches()):
            _rectangle(axes, patch, edgecolor=COLOURS[0], linewidth=0.8, linestyle=":")
        label = f"{case.atoms.ranks} MD patches" if case.atoms.ranks > 1 else "1 MD patch"
        axes.plot([], [], ":", color=COLOURS[0], label=label)
    for crack in case.continuum.cracks:
        x, y, *_ = zip(*crack.corners(), crack.start, strict=True)
        axes.plot(x, y, color=COLOURS[5], lw=2.0, label="crack")
    _draw_loads(axes, case)
    _frame(axes, case.domain.box, _unit(case, "length"))
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.06), ncols=3, fontsize=9)
    return _save(figure, path)


def _draw_cells(axes: Axes, box: Box, h: float) -> None:
    """Lines of the cells of a box."""
    (x0, x1), (y0, y1) = box[:2]
    style = {"color": "#E4E4E4", "lw": 0.5, "zorder": 0}
    axes.vlines(np.arange(x0, x1 + 0.5 * h, h), y0, y1, **style)
    axes.hlines(np.arange(y0, y1 + 0.5 * h, h), x0, x1, **style)


def _draw_zones(axes: Axes, case: Case, region_box: Box, region: MdRegion, labelled: bool) -> None:
    """Zones of a region as coloured frames, from outside in."""
    from matplotlib.patches import Rectangle

    edge = region_box
    for name, inner in zone_outlines(case, region):
        (x0, x1), (y0, y1) = edge
        colour, label = ZONE_COLOURS[name], f"{name} zone" if labelled else None
        axes.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, facecolor=colour, lw=0, label=label))
        edge = inner
    (x0, x1), (y0, y1) = edge
    axes.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, facecolor="white", lw=0))
    label = "MD region" if labelled else None
    _rectangle(axes, region_box, edgecolor=INK, linewidth=1.2, label=label)


def _draw_loads(axes: Axes, case: Case) -> None:
    """Name the condition of each loaded face beside it."""
    (x0, x1), (y0, y1) = case.domain.box[:2]
    places = {
        (0, 0): (x0, 0.5 * (y0 + y1), 8, 0, 90),
        (0, 1): (x1, 0.5 * (y0 + y1), -8, 0, 90),
        (1, 0): (0.5 * (x0 + x1), y0, 0, 6, 0),
        (1, 1): (0.5 * (x0 + x1), y1, 0, 6, 0),
    }
    for (axis, side), (x, y, dx, dy, turn) in places.items():
        face = case.boundary.face(axis, side)
        if face.condition == "free":
            continue
        parts = ["-" if v is None else f"{v:g}" for v in face.value]
        value = f" ({', '.join(parts)})" if parts else ""
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


def draw_crossing(verdict: Verdict, path: Path) -> Path:
    """Draw transmitted and reflected energy over the wavelength, beside grid and atoms alone."""
    pyplot = _pyplot()
    figure, panels = pyplot.subplots(2, 2, figsize=(9, 6), sharex=True, sharey="row")
    straight = [row for row in verdict.rows if row.degrees == 0.0]
    oblique = [row for row in verdict.rows if row.degrees > 0.0]
    for column, kind in enumerate("PS"):
        for line, share in enumerate(("transmitted", "reflected")):
            axes = panels[line, column]
            for travel, colour, label in (
                ("into", COLOURS[0], "into the atoms"),
                ("out", COLOURS[5], "out of the atoms"),
            ):
                for rows, style in ((straight, "o-"), (oblique, "^")):
                    chosen = [r for r in rows if (r.polarization, r.travel) == (kind, travel)]
                    if chosen:
                        angle = f", {chosen[0].degrees:.0f} degrees" if rows is oblique else ""
                        axes.plot(
                            [r.wavelength for r in chosen],
                            [getattr(r, share) for r in chosen],
                            style,
                            color=colour,
                            label=label + angle,
                        )
            once = [r for r in straight if (r.polarization, r.travel) == (kind, "into")]
            for side, colour, label in (
                ("grid", SOFT, "grid alone"),
                ("md", COLOURS[2], "atoms alone"),
            ):
                values = [getattr(r, f"{side}_{share}") for r in once]
                if None not in values:
                    lengths = [r.wavelength for r in once]
                    axes.plot(lengths, values, "--", color=colour, label=label)
            axes.set_xscale("log")
            axes.set_ylabel(f"{share} energy")
        panels[0, column].set_title(f"{kind} waves")
        panels[1, column].set_xlabel("wavelength / h")
        panels[1, column].set_yscale("symlog", linthresh=1e-3)
    ticks = sorted({row.wavelength for row in verdict.rows})
    panels[0, 0].set_xticks(ticks, [f"{tick:g}" for tick in ticks], minor=False)
    panels[0, 0].set_xticks([], minor=True)
    panels[0, 0].legend(fontsize=8)
    return _save(figure, path)

"""Figures of fields: their layout, and the windows in which atoms can be seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimpmd_deploy.analysis.crack import crack_of, crack_tip
from gimpmd_deploy.figures.shown import Shown
from gimpmd_deploy.figures.style import DPI, Axes, Figure, pyplot
from gimpmd_deploy.results.particles import Particles
from gimpmd_deploy.results.run import Run
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.grid.zones import Box, Zones


@dataclass(frozen=True)
class Layout:
    """Axes for the whole body, for square windows beside it (below a wide body), and a colour bar.

    They are placed by hand: automatic layouts clip labels or shrink axes of a fixed aspect.
    """

    figure: Figure
    whole: Axes
    details: list[Axes]
    bar: Axes


def make_layout(box: Box, windows: int, dpi: int = DPI) -> Layout:
    """Place the axes of a body and of its windows, in a figure of so many pixels per inch."""
    (x0, x1), (y0, y1) = box[:2]
    ratio = float(np.clip((y1 - y0) / (x1 - x0), 0.15, 3.0))
    width = 6.4 if ratio < 1.5 else 4.2
    height, left, bottom, gap, top = width * ratio, 0.85, 1.85, 0.55, 0.45
    beside = ratio >= 0.75
    gap = gap if beside else 1.25  # for the colour bar of a window
    side = (height - gap) / 2 if beside else (width - gap) / 2
    below = side + 0.8 if windows and not beside else 0.0
    right = side + gap + 0.8 if windows and beside else 0.25
    size = (left + width + right, bottom + below + height + top)
    figure = pyplot().figure(figsize=size, dpi=dpi, layout="none")

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
    return Layout(figure, whole, details, place(left + 0.15 * width, 1.02, 0.7 * width, 0.13))


Window = tuple[tuple[float, float], tuple[float, float]]
"""A rectangle in the x-y plane: its limits along x and y."""

TIP, LARGEST, INTERFACE = "crack tip", "largest value", "interface"
WINDOWS = (TIP, LARGEST, INTERFACE)
"""Names of windows."""

REACH = 18.0
"""Half of the width of a window, in distances of neighbouring atoms."""


def windows_of(run: Run, shown: Shown, name: str) -> dict[str, Window]:
    """Return where to look closer: at the crack tip or the largest value, and at the interface.

    Parameters
    ----------
    shown : Shown
        What the figure shows.
    name : str
        The field.
    """
    seen = shown.atoms if shown.atoms is not None else shown.points
    if seen is None or not len(seen):
        return {}
    plan, windows = run.plan, {}
    zones = None if plan.coupling is None else plan.coupling.zones
    half = REACH * float(seen.size.min())
    if plan.continuum.cracks:
        windows[TIP] = _window(tip_of(run, shown.all_atoms), half)
    elif shown.atoms is not None and name in shown.atoms.fields:
        inside = _far_from_faces(plan, shown.atoms) > 0.25 * half
        if zones is not None:
            inside &= zones.depth(shown.atoms.reference) > zones.handover
        deep = shown.atoms.where(inside)
        if len(deep):
            hottest = deep.position[np.argmax(np.abs(deep.fields[name]))]
            windows[LARGEST] = _window(_into(shown.atoms, hottest, half), half)
    if zones is not None:
        half = max(0.9 * zones.innermost, 2.0 * plan.finest_cell)
        windows[INTERFACE] = _window(_interface(zones), half)
    return windows


def tip_of(run: Run, atoms: Particles | None) -> Floats:
    """Position of the tip of the first crack of the case, shape ``(d,)``.

    It is found from the atoms if the crack ends among them; see `crack_tip`. In the continuum a
    crack does not grow.
    """
    end = np.array(run.plan.continuum.cracks[0].end)
    regions = () if run.plan.md is None else run.plan.md.regions
    if atoms is None or not any(_contains(box, end) for box in regions):
        return end
    return crack_tip(atoms, crack_of(run)).position


def _into(particles: Particles, centre: Floats, half: float) -> Floats:
    """Move the centre of a window such that particles fill it, as far as there are enough."""
    edge = 0.5 * particles.size[0]
    low, high = particles.position.min(axis=0) - edge, particles.position.max(axis=0) + edge
    middle, room = 0.5 * (low + high), np.maximum(0.5 * (high - low) - half, 0.0)
    return np.asarray(np.clip(centre, middle - room, middle + room))


def _contains(box: Box, place: Floats) -> bool:
    return all(low < x < high for (low, high), x in zip(box, place, strict=True))


def _far_from_faces(plan: Plan, atoms: Particles) -> Floats:
    """Distance of atoms from the nearest face of the domain."""
    faces = np.array(plan.domain.box)
    x = atoms.reference
    return np.asarray(np.minimum(x - faces[:, 0], faces[:, 1] - x).min(axis=1))


def _interface(zones: Zones) -> Floats:
    """A point in the zones of the first region: at a corner, or in the middle of an interface."""
    region = zones.regions[0]
    place = [0.5 * (low + high) for low, high in region.box]
    for axis, (low, high) in enumerate(region.interfaces):
        if high or low:
            face = region.box[axis][1] if high else region.box[axis][0]
            place[axis] = face + (-0.5 if high else 0.5) * zones.innermost
    return np.array(place)


def _window(centre: Floats, half: float) -> Window:
    return (
        (centre[0] - half, centre[0] + half),
        (centre[1] - half, centre[1] + half),
    )


def inside(particles: Particles | None, window: Window) -> Particles | None:
    """Return the particles that show in a window."""
    if particles is None:
        return None
    near = np.ones(len(particles), dtype=np.bool_)
    for axis, (low, high) in enumerate(window):
        reach = particles.size[:, axis]
        near &= (particles.position[:, axis] > low - reach) & (
            particles.position[:, axis] < high + reach
        )
    return particles.where(near)

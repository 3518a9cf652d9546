"""The figure of the stress: its layout, and the windows in which atoms can be seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimpmd_deploy.figures.style import Axes, Figure, pyplot
from gimpmd_deploy.results.particles import Particles
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


def make_layout(box: Box, windows: int) -> Layout:
    """Place the axes of a body and of its windows."""
    (x0, x1), (y0, y1) = box[:2]
    ratio = float(np.clip((y1 - y0) / (x1 - x0), 0.15, 3.0))
    width = 6.4 if ratio < 1.5 else 4.2
    height, left, bottom, gap, top = width * ratio, 0.85, 1.45, 0.55, 0.45
    beside = ratio >= 0.75
    gap = gap if beside else 1.25  # for the colour bar of a window
    side = (height - gap) / 2 if beside else (width - gap) / 2
    below = side + 0.8 if windows and not beside else 0.0
    right = side + gap + 0.75 if windows and beside else 0.25
    size = (left + width + right, bottom + below + height + top)
    figure = pyplot().figure(figsize=size, layout="none")

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
    return Layout(figure, whole, details, place(left + 0.15 * width, 0.62, 0.7 * width, 0.13))


Window = tuple[tuple[float, float], tuple[float, float]]
"""A square in the x-y plane: its limits along x and y."""


def windows_of(plan: Plan, atoms: Particles | None) -> list[tuple[str, Window]]:
    """Return where to look closer: at the crack tip or the largest stress, and at the interface."""
    if atoms is None or not len(atoms):
        return []
    zones = None if plan.coupling is None else plan.coupling.zones
    half = 18.0 * float(atoms.size[0, 0])
    windows = []
    if plan.continuum.cracks:
        tip = np.array(plan.continuum.cracks[0].end)
        windows.append(("crack tip", _window(tip, half)))
    else:
        inside = _far_from_faces(plan, atoms) > 0.25 * half
        if zones is not None:
            inside &= zones.depth(atoms.reference) > zones.handover
        deep = atoms.where(inside)
        if len(deep):
            hot = deep.position[np.argmax(np.abs(deep.stress[:, 1]))]
            windows.append(("largest stress", _window(hot, half)))
    if zones is not None:
        half = max(0.9 * zones.innermost, 2.0 * plan.finest_cell)
        windows.append(("interface", _window(_interface(zones), half)))
    return windows


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

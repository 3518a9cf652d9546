"""Atoms and material points in the x-y plane, coloured by a scalar field.

Particles of several pixels are drawn as discs and rectangles, smaller ones as an image of their
mean values.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gimpmd_deploy.figures.colours import Scale
from gimpmd_deploy.figures.raster import mean_image
from gimpmd_deploy.figures.style import FAINT, INK, SOFT, Axes
from gimpmd_deploy.results.particles import Particles
from gimpmd_schemas.arrays import Floats

SINGLE = 6.0
"""Least size in pixels of particles that are drawn one by one."""

ATOM, POINT = 1.3, 1.06
"""Widths of particles in an image, in distances of atoms and in edges of points: particles of a
stretched body overlap, and atoms reach the points beside them, so no background shows between."""


def in_slice(particles: Particles, z: float) -> Particles:
    """Return the particles that the plane at ``z`` cuts; in two dimensions all of them.

    They count as a little larger than they are, so that no plane falls between two layers.
    """
    if particles.dim == 2:
        return particles
    reach = 0.5 * POINT * particles.size[:, 2]
    return particles.where(np.abs(particles.position[:, 2] - z) <= reach)


def draw_points(axes: Axes, points: Particles | None, name: str, scale: Scale) -> None:
    """Draw material points on axes whose limits are set; grey where they lack the field."""
    from matplotlib.collections import PolyCollection

    if points is None or not len(points):
        return
    values = points.fields.get(name)
    if np.median(points.size[:, 0]) < SINGLE * _pixel(axes):
        _draw_image(axes, points, POINT * points.size[:, :2], values, scale)
        return
    corners = 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    squares = points.position[:, None, :2] + points.size[:, None, :2] * corners
    style: Any = {"linewidths": 0.3, "edgecolors": SOFT, "rasterized": True, **_fill(values, scale)}
    axes.add_collection(PolyCollection(list(squares), **style))


def draw_atoms(axes: Axes, atoms: Particles | None, name: str, scale: Scale) -> None:
    """Draw atoms on axes whose limits are set; grey where they lack the field."""
    if atoms is None or not len(atoms):
        return
    values = atoms.fields.get(name)
    if atoms.size[0, 0] < SINGLE * _pixel(axes):
        _draw_image(axes, atoms, ATOM * atoms.size[:, :2], values, scale)
    else:
        draw_discs(axes, atoms, linewidths=0.3, edgecolors=INK, **_fill(values, scale))


def draw_rings(axes: Axes, atoms: Particles | None) -> None:
    """Draw atoms that follow the continuum as empty circles, if they are large enough."""
    if atoms is not None and len(atoms) and atoms.size[0, 0] >= SINGLE * _pixel(axes):
        draw_discs(axes, atoms, facecolors="none", edgecolors=SOFT, linewidths=0.4)


def draw_discs(axes: Axes, atoms: Particles, **style: Any) -> None:
    """Draw atoms as discs of nearly the diameter of their distance, in data units."""
    from matplotlib.collections import EllipseCollection

    width = 0.96 * atoms.size[:, 0]
    axes.add_collection(
        EllipseCollection(
            width,
            width,
            np.zeros(width.size),
            units="xy",
            offsets=atoms.position[:, :2],
            offset_transform=axes.transData,
            rasterized=True,
            **style,
        )
    )


def _fill(values: Floats | None, scale: Scale) -> dict[str, Any]:
    if values is None:
        return {"facecolors": FAINT}
    return {"array": values, "cmap": scale.cmap, "clim": (scale.low, scale.high)}


def _pixel(axes: Axes) -> float:
    """Width of a pixel in data units."""
    low, high = axes.get_xlim()
    return float((high - low) / axes.get_window_extent().width)


def _draw_image(
    axes: Axes, particles: Particles, size: Floats, values: Floats | None, scale: Scale
) -> None:
    """Draw the mean of the particles in each pixel of the axes."""
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    pixel = _pixel(axes)
    shape = (int(np.ceil((y1 - y0) / pixel)), int(np.ceil((x1 - x0) / pixel)))
    centre = (particles.position[:, :2] - (x0, y0)) / pixel
    half = 0.5 * size / pixel
    known = np.ones(len(particles)) if values is None else values
    image = mean_image(centre - half, centre + half, known, shape)
    style: dict[str, Any] = {"cmap": scale.cmap, "vmin": scale.low, "vmax": scale.high}
    if values is None:
        from matplotlib.colors import ListedColormap

        style = {"cmap": ListedColormap([FAINT])}
    axes.imshow(
        image,
        extent=(x0, x0 + shape[1] * pixel, y0, y0 + shape[0] * pixel),
        origin="lower",
        interpolation="nearest",
        aspect="equal",
        zorder=1,
        **style,
    )
    axes.set_xlim(x0, x1)
    axes.set_ylim(y0, y1)

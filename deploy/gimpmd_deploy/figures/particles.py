"""Atoms and material points in the x-y plane, coloured by stress."""

from __future__ import annotations

from typing import Any

import numpy as np

from gimpmd_deploy.figures.style import INK, SOFT, Axes
from gimpmd_deploy.results.particles import Particles

STRESS_MAP = "RdBu_r"


def in_slice(particles: Particles, z: float) -> Particles:
    """Return the particles that the plane at ``z`` cuts; in two dimensions all of them."""
    if particles.dim == 2:
        return particles
    return particles.where(np.abs(particles.position[:, 2] - z) <= 0.5 * particles.size[:, 2])


def draw_particles(
    axes: Axes, points: Particles | None, atoms: Particles | None, limit: float, cover: bool
) -> Any:
    """Draw points as rectangles and atoms as discs, coloured by sigma_yy; return the colours.

    Parameters
    ----------
    limit : end of the symmetric colour scale.
    cover : let the particles overlap, so that the background does not show between them.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import Normalize

    norm = Normalize(-limit, limit)
    if points is not None:
        corners = (0.53 if cover else 0.5) * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        squares = points.position[:, None, :2] + points.size[:, None, :2] * corners
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
    draw_discs(
        axes,
        atoms,
        1.16 if cover else 0.96,
        array=None if atoms is None else atoms.stress[:, 1],
        cmap=STRESS_MAP,
        norm=norm,
        **({"edgecolors": INK} | style),
    )
    return ScalarMappable(norm, STRESS_MAP)


def draw_discs(axes: Axes, atoms: Particles | None, scale: float = 0.96, **style: Any) -> None:
    """Draw atoms as discs of the diameter of their distance, in data units."""
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
            offsets=atoms.position[:, :2],
            offset_transform=axes.transData,
            rasterized=True,
            **style,
        )
    )

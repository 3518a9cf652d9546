"""The angle of Mach lines, from the velocity of the atoms beside a slip plane.

The velocity is averaged in the cells of a grid along the plane. Across a line, the velocity changes
along the normal of the line. So the directions of the velocity gradient, weighted by its square,
have a peak at the direction of the lines; noise and smooth fields spread over all directions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

from gimpmd_deploy.analysis.plane import Plane
from gimpmd_deploy.results.particles import Particles
from gimpmd_schemas.arrays import Floats

BINS = 180
"""Classes of direction, of one degree each."""

WIDTH = 15.0
"""Directions within so many degrees of the peak are averaged."""

CELL = 0.5
"""Edge of the cells, in distances of neighbours: the filter, not the grid, limits what is seen."""

COARSE = 4.0
"""Width of the filter whose result is subtracted, over that of the first filter.

The difference keeps lines and removes smooth fields, such as the shear of the plates.
"""


@dataclass(frozen=True)
class MachAngle:
    """Angle between the slip plane and the Mach lines, in degrees from 0 to 180.

    Lines that trail behind a pulse that runs along the direction of the plane have angles below 90
    on both sides.

    Attributes
    ----------
    above, below : float
        On the two sides of the plane.
    spread_above, spread_below : float
        Root mean square of the directions around the peak (degrees).
    share : float
        Part of the squared velocity gradient whose direction is near the peak. It is 1/6 for a
        field without a direction, and 1 for straight parallel lines.
    """

    above: float
    below: float
    spread_above: float
    spread_below: float
    share: float

    @property
    def mean(self) -> float:
        """Mean of both sides (degrees)."""
        return 0.5 * (self.above + self.below)

    def speed(self, wave_speed: float) -> float:
        """Speed of a source whose waves of this speed form the lines: ``c / sin(angle)``."""
        return wave_speed / float(np.sin(np.radians(self.mean)))


def mach_angle(
    atoms: Particles,
    plane: Plane,
    along: tuple[float, float],
    heights: tuple[float, float],
    *,
    smoothing: float | None = None,
) -> MachAngle:
    """Measure the angle of the Mach lines on both sides of a slip plane.

    Parameters
    ----------
    atoms : Particles
        Of one output in two dimensions; the component of the velocity along the plane is used.
    plane : Plane
        The slip plane, along the direction in which the pulse runs.
    along : tuple of float
        Part of the plane, as distances from its origin.
    heights : tuple of float
        Smallest and largest distance of the atoms from the plane. Atoms beside the plane take part
        in the slip itself; leave out several rows.
    smoothing : float, optional
        Width (standard deviation) of the Gaussian average of the velocity; default is two distances
        of neighbours. Fields that are smooth over four times this width are removed.

    Returns
    -------
    MachAngle

    Raises
    ------
    ValueError
        The part of the plane holds too few atoms, or they do not move.
    """
    spacing = float(atoms.size[0, 0])
    width = 2.0 * spacing if smoothing is None else smoothing
    x, y = plane.position(atoms.position), plane.height(atoms.position)
    v = atoms.velocity @ plane.along
    found = [_angle(x, side * y, v, along, heights, CELL * spacing, width) for side in (1.0, -1.0)]
    (above, spread_above, share_above), (below, spread_below, share_below) = found
    return MachAngle(above, below, spread_above, spread_below, 0.5 * (share_above + share_below))


def _angle(
    x: Floats,
    y: Floats,
    v: Floats,
    along: tuple[float, float],
    heights: tuple[float, float],
    edge: float,
    width: float,
) -> tuple[float, float, float]:
    """Angle of the lines at positive heights, spread of the directions, and share near the peak."""
    counts = [int((high - low) / edge) for low, high in (along, heights)]
    if min(counts) * edge < 4.0 * width:
        raise ValueError(
            f"the part of the plane is too small for an average over {width:g}: make it at least "
            f"{4.0 * width:g} wide and high, or give a smaller smoothing"
        )
    place = [np.floor((q - low) / edge).astype(int) for q, (low, _) in ((x, along), (y, heights))]
    inside = np.all([(k >= 0) & (k < n) for k, n in zip(place, counts, strict=True)], axis=0)
    cells = np.ravel_multi_index([k[inside] for k in place], counts)
    size = counts[0] * counts[1]
    number, total = (
        np.asarray(np.bincount(cells, values, size), dtype=float).reshape(counts)
        for values in (np.ones(cells.size), v[inside])
    )
    if not number.any() or not total.any():
        raise ValueError("there are no moving atoms in this part of the plane")
    # the average near a cell; cells without atoms do not count
    sigma = width / edge
    weight, fine = _average(total, number, sigma)
    field = fine - _average(total, number, COARSE * sigma)[1]
    rim = int(np.ceil(sigma))
    inner = (slice(rim, -rim), slice(rim, -rim))
    gx, gy = (np.gradient(field, axis=axis)[inner].ravel() for axis in range(2))
    filled = (weight > 0.3 * weight.max())[inner].ravel()
    square = np.where(filled, gx**2 + gy**2, 0.0)
    # a line that trails at an angle has the normal (sin angle, cos angle)
    direction = np.degrees(np.arctan2(gx, gy)) % 180.0
    return _peak(direction, square)


def _average(total: Floats, number: Floats, sigma: float) -> tuple[Floats, Floats]:
    """Gaussian average over the atoms near each cell: number of atoms, and mean of the values."""
    weight = gaussian_filter(number, sigma, mode="constant")
    mean = gaussian_filter(total, sigma, mode="constant") / np.maximum(weight, 1e-12)
    return np.asarray(weight), np.asarray(mean)


def _peak(direction: Floats, weight: Floats) -> tuple[float, float, float]:
    """Mean direction around the most frequent one (degrees, period 180), its spread and share."""
    histogram = np.histogram(direction, BINS, (0.0, 180.0), weights=weight)[0]
    smooth = gaussian_filter(histogram, 0.25 * WIDTH * BINS / 180.0, mode="wrap")
    peak = (np.argmax(smooth) + 0.5) * 180.0 / BINS
    for _ in range(3):  # centre the window on its own mean
        away = (direction - peak + 90.0) % 180.0 - 90.0
        near = np.abs(away) < WIDTH
        peak += np.average(away[near], weights=weight[near])
    away = (direction - peak + 90.0) % 180.0 - 90.0
    near = np.abs(away) < WIDTH
    spread = np.sqrt(np.average(away[near] ** 2, weights=weight[near]))
    return float(peak % 180.0), float(spread), float(weight[near].sum() / weight.sum())

"""Planes that end at faces of the body.

At a free or loaded face the layers of the crystal end unevenly, with a period of their own: in a
hexagonal crystal every second row ends half a spacing deeper. The crystal is calibrated as if it
went on beyond the face. Then a shear strain leaves a moment where plane 2 meets the face, which no
stress near the planes can balance. It depends on where the outermost layer within plane 2 ends, so
in two dimensions the planes of a region are chosen such that its moments cancel, if they can be.
Otherwise the continuum leaves out balance under strains that load the face.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from gimpmd_md.crystal.plane_pairs import Planes
from gimpmd_md.crystal.recognise import Crystal
from gimpmd_schemas.case.form import FACES

EVEN = 1e-6
"""Largest accepted sum of moments, over stress times the area of a primitive cell."""


class Face(NamedTuple):
    """A face of the body: its axis and side, 0 or 1, and its coordinate (length)."""

    axis: int
    side: int
    end: float

    @property
    def name(self) -> str:
        """Name in the case file."""
        return FACES[2 * self.axis + self.side]


def depth_of_layers(crystal: Crystal, face: Face) -> float:
    """Distance of a face from the outermost layer of sites, in distances of these layers.

    A half is right: then the body holds as much crystal as continuum.
    """
    layers = crystal.layers(face.axis)
    spacing = None if layers is None else layers.spacing()
    if layers is None or spacing is None:
        return np.nan
    beyond = (face.end - layers.places[0]) / spacing
    inward = beyond if face.side else -beyond
    return float(inward - np.floor(inward))


def moment(crystal: Crystal, axis: int, side: int, plane: float, face: Face) -> float:
    """Moment where plane 2 meets a face, per shear stress (area).

    Adding a layer, spaced ``l``, that ends ``p`` deeper below the face than layers do on average
    adds ``l p`` to the moment. So it is the sum of ``l p`` over the layers up to the plane, less
    the mean of this sum over a period.

    Parameters
    ----------
    axis, side : int
        Those of the plane.
    plane : float
        Coordinate of plane 2 (length), midway between layers.
    """
    period, along = crystal.period(axis), crystal.period(face.axis)
    if period is None or along is None:
        raise ValueError("the crystal does not repeat along the axes")
    box = [(0.0, along)] * 2
    box[axis] = plane - period, plane
    box[face.axis] = face.end - along, face.end
    x = crystal.sites(tuple(box)).x
    x = x[np.argsort(x[:, axis])]
    deep = face.end - x[:, face.axis]  # below an upper face, of the outermost site of each layer
    if face.side == 0:
        deep = along - deep
    sums = period / len(x) * np.cumsum(deep - 0.5 * along)
    # mirrored along an axis, or with the axes exchanged, the same strain leaves the opposite moment
    sign = (1.0 if side else -1.0) * (1.0 if axis > face.axis else -1.0)
    return float(sign * (sums[-1] - sums.mean()))


def even(
    crystal: Crystal, options: Sequence[tuple[int, int, list[Planes]]], faces: Sequence[Face]
) -> list[Planes] | None:
    """Choose the planes of a region such that moments at faces of the body cancel.

    Parameters
    ----------
    options : sequence
        Axis and side of each plane, and where it may be, the best place first.
    faces : sequence of Face
        Those that the region reaches.

    Returns
    -------
    list of Planes or None
        For each of the options; None: no choice makes the moments cancel. The least clear plane 2
        is as clear of node lines as can be. Without faces these are the best places.
    """
    found = []
    for axis, side, places in options:
        met = [face for face in faces if face.axis != axis]
        found.append([sum(moment(crystal, axis, side, p.second, f) for f in met) for p in places])
    chosen, best = None, (-np.inf, -np.inf)
    for numbers in product(*(range(len(places)) for _, _, places in options)):
        if abs(sum(f[n] for f, n in zip(found, numbers, strict=True))) < EVEN * crystal.volume:
            planes = [places[n] for (_, _, places), n in zip(options, numbers, strict=True)]
            clear = [p.clear for p in planes]
            if (min(clear), sum(clear)) > best:
                chosen, best = planes, (min(clear), sum(clear))
            if not any(numbers):
                break  # the best places of all
    return chosen

"""Parts of the faces of the domain: where each condition acts, and its value there."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from gimpmd_schemas.arrays import Bools, Floats
from gimpmd_schemas.case.conditions import Face
from gimpmd_schemas.case.form import Boundary
from gimpmd_schemas.case.profiles import Components, components, value_at
from gimpmd_schemas.grid.zones import Box, in_box


@dataclass(frozen=True)
class FacePart:
    """A part of a face of the domain, with its condition.

    Attributes
    ----------
    axis, side : int
        Normal of the face; lower (0) or upper (1) face.
    key : str
        Key of the condition in the case file.
    condition : Face
    domain : Box
    stiffness : ndarray
        Stiffness of the continuum in Voigt order (pressure units); profiles may need it.
    """

    axis: int
    side: int
    key: str
    condition: Face
    domain: Box
    stiffness: Floats = field(compare=False, repr=False)

    @property
    def region(self) -> Box | None:
        """Positions that belong to the part, half-open; None: all of the face.

        The region is unbounded along the normal and where the part ends with the face.
        """
        if not self.condition.extent:
            return None
        region, extent = list[tuple[float, float]](), iter(self.condition.extent)
        for axis, (low, high) in enumerate(self.domain):
            start, end = (low, high) if axis == self.axis else next(extent)
            region.append((start if start > low else -math.inf, end if end < high else math.inf))
        return tuple(region)

    @property
    def components(self) -> Components:
        """Components that the condition prescribes; None for one that is free."""
        if self.condition.condition == "symmetry":
            return tuple(0.0 if axis == self.axis else None for axis in range(len(self.domain)))
        return components(self.condition.value)

    def covers(self, x: Floats) -> Bools:
        """Which positions ``(n, d)`` belong to the part, whatever their distance from the face."""
        return in_part(self.region, x)

    def holds(self, x: Floats, tolerance: float) -> Bools:
        """Which positions ``(n, d)`` lie on the part, within a tolerance (length)."""
        place = self.domain[self.axis][self.side]
        on_face: Bools = np.abs(x[:, self.axis] - place) < tolerance
        return on_face & self.covers(x)

    def overlap(self, box: Box) -> float:
        """Length (area in three dimensions) of the part within a box."""
        region, size = self.region or box, 1.0
        for axis, ((low, high), (start, end)) in enumerate(zip(box, region, strict=True)):
            if axis != self.axis:
                size *= max(0.0, min(high, end) - max(low, start))
        return size

    def value(self, x: Floats) -> Floats:
        """Full value ``(n, d)`` at positions at rest ``(n, d)``, in units of the case."""
        return value_at(self.condition.value, x, self.stiffness)


def in_part(region: Box | None, x: Floats) -> Bools:
    """Which positions ``(n, d)`` lie in the region of a part; see `FacePart.region`."""
    return np.ones(x.shape[0], dtype=np.bool_) if region is None else in_box(region, x)


def face_parts(boundary: Boundary, domain: Box, stiffness: Floats) -> list[FacePart]:
    """All parts that have a condition other than free, in the order of faces and of the file."""
    return [
        FacePart(axis, side, key, face, domain, stiffness)
        for axis, side in product(range(len(domain)), range(2))
        for key, face in boundary.parts(axis, side).items()
        if face.condition != "free"
    ]

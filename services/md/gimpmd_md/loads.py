"""Loads and prescribed motion on those faces of the atoms' box that lie on the domain's rim."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.form import FACES, Case, Face
from gimpmd_schemas.mechanics.units import UNITS


@dataclass(frozen=True)
class RimFace:
    """Faces of MD regions on one face of the domain, with a condition other than free.

    Attributes
    ----------
    axis, side : int
        Normal direction (0, 1); lower (0) or upper (1) face.
    condition : Face
    length : float
        Length of the face, of all regions together.
    """

    axis: int
    side: int
    condition: Face
    length: float

    @property
    def name(self) -> str:
        """The name of the face in the case file."""
        return FACES[2 * self.axis + self.side]

    def force(self, units: str) -> tuple[float, float]:
        """Total force of a full traction on the face (force units of the style)."""
        per_pressure = self.length / UNITS[units].nktv2p
        value = self.condition.value
        return (per_pressure * (value[0] or 0.0), per_pressure * (value[1] or 0.0))

    def velocity(self) -> tuple[float | None, float | None]:
        """Velocity that the face's atoms take in full; None where a component is free."""
        if self.condition.condition == "symmetry":
            return (0.0, None) if self.axis == 0 else (None, 0.0)
        x, y = self.condition.value
        return (x, y)

    def mean_factor(self, start: float, end: float) -> float:
        """Mean factor over a window of time, so that impulse or displacement is exact."""
        return self.condition.mean_factor(start, end)

    def outermost(self, x: Floats) -> float:
        """Coordinate of the outermost of the positions ``x``; infinitely far in if none."""
        if x.shape[0] == 0:
            return -np.inf if self.side else np.inf
        return float(x[:, self.axis].max() if self.side else x[:, self.axis].min())


def rim_faces(case: Case, condition: tuple[str, ...]) -> list[RimFace]:
    """Faces on the domain's rim where atoms reach it and that have one of the conditions."""
    found = []
    boxes, regions = case.md_regions(), case.zones().regions
    for axis in range(2):
        for side in range(2):
            lengths = [
                box[1 - axis][1] - box[1 - axis][0]
                for box, region in zip(boxes, regions, strict=True)
                if not region.interfaces[axis][side]
            ]
            face = case.boundary.face(axis, side)
            if face.condition in condition and lengths:
                found.append(RimFace(axis, side, face, sum(lengths)))
    return found

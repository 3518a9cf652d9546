"""Conditions on the faces of the domain: tractions, velocities, symmetry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimpmd_gimp.kernels import scatter_points
from gimpmd_gimp.points import MaterialPoints
from gimpmd_schemas.case import Case, Face
from gimpmd_schemas.grid import BackgroundGrid, Bools, Floats, Ints
from gimpmd_schemas.units import UNITS

HAT = 1e-9
"""Half-width of a particle edge across the face, in cells: a line, not an area."""


@dataclass(frozen=True)
class Traction:
    """A traction on the outer edges of the points along a face (mechanical units)."""

    face: Face
    axis: int
    side: int
    points: Ints
    traction: tuple[float, float]

    def nodal_force(
        self, points: MaterialPoints, origin: Floats, h: float, columns: int, size: int
    ) -> Floats:
        """Nodal force of the full traction, shape ``(size, 2)``.

        The load acts on the edge that the point turns outward and follows it as it moves; across
        the face it is shared by hat functions, so a face on a line of nodes loads that line.
        """
        edge = points.x[self.points].copy()
        outward = 1.0 if self.side else -1.0
        edge[:, self.axis] += outward * h * points.half[self.points, self.axis]
        half = points.half[self.points].copy()
        length = 2.0 * h * half[:, 1 - self.axis]
        half[:, self.axis] = HAT
        force = np.zeros((size, 2))
        load = length[:, None] * np.asarray(self.traction)
        scatter_points(edge, half, load, origin, h, columns, force)
        return force


@dataclass(frozen=True)
class Driven:
    """Nodes on and beyond a face whose velocity component is prescribed."""

    face: Face
    component: int
    value: float
    nodes: Ints

    def velocity(self, time: float) -> float:
        """Prescribed velocity at ``time``."""
        return self.value * self.face.factor(time)


def make_tractions(case: Case, grid: BackgroundGrid, points: MaterialPoints) -> list[Traction]:
    """Tractions of the case; the loaded points are those whose edge lies on the face."""
    units = UNITS[case.units]
    layer = 0.75 * grid.cell / case.grid.points_per_cell
    tractions = []
    for axis, side, face in _faces(case):
        if face.condition != "traction":
            continue
        rim = case.domain.box[axis][side]
        on_face = np.abs(points.reference[:, axis] - rim) < layer
        values = [units.stress_to_mechanical(v or 0.0) for v in face.value]
        chosen = np.flatnonzero(on_face).astype(np.int64)
        tractions.append(Traction(face, axis, side, chosen, (values[0], values[1])))
    return tractions


def make_driven(case: Case, grid: BackgroundGrid, positions: Floats) -> list[Driven]:
    """Prescribed nodal velocities of the case, at node positions ``(size, 2)``."""
    driven = []
    for axis, side, face in _faces(case):
        nodes = np.flatnonzero(_on_or_beyond(case, grid, positions, axis, side)).astype(np.int64)
        if face.condition == "symmetry":
            driven.append(Driven(face, axis, 0.0, nodes))
        if face.condition == "velocity":
            for component, value in enumerate(face.value):
                if value is not None:
                    driven.append(Driven(face, component, value, nodes))
    return driven


def _faces(case: Case) -> list[tuple[int, int, Face]]:
    return [(axis, side, case.boundary.face(axis, side)) for axis in range(2) for side in range(2)]


def _on_or_beyond(
    case: Case, grid: BackgroundGrid, positions: Floats, axis: int, side: int
) -> Bools:
    rim, slack = case.domain.box[axis][side], 1e-6 * grid.cell
    if side:
        return np.asarray(positions[:, axis] > rim - slack)
    return np.asarray(positions[:, axis] < rim + slack)

"""Tractions and prescribed velocities on the faces of MD regions that lie on the domain's rim."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gimpmd_md.engines.atoms import Atoms
from gimpmd_md.roles import CORE, traction_bit, velocity_bit
from gimpmd_md.sums import extent, mean_velocity, periods
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.case.conditions import Face
from gimpmd_schemas.case.form import FACES
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.mechanics.units import UNITS


@dataclass(frozen=True)
class RimFace:
    """Faces of MD regions on one face of the domain, with a condition other than free.

    Attributes
    ----------
    axis, side : int
        Normal direction; lower (0) or upper (1) face.
    condition : Face
    size : float
        Length of the face in two dimensions, area in three; of all regions together.
    """

    axis: int
    side: int
    condition: Face
    size: float

    @property
    def name(self) -> str:
        """Name of the face in the case file."""
        return FACES[2 * self.axis + self.side]

    def force(self, units: str) -> Floats:
        """Total force of the full traction on the face (force units), shape ``(d,)``."""
        per_pressure = self.size / UNITS[units].nktv2p
        return np.array([per_pressure * (value or 0.0) for value in self.condition.value])

    def velocity(self, dim: int) -> tuple[float | None, ...]:
        """Full velocity of the face's atoms; None for a component that is free."""
        if self.condition.condition == "symmetry":
            return tuple(0.0 if axis == self.axis else None for axis in range(dim))
        return self.condition.value

    def mean_factor(self, start: float, end: float) -> float:
        """Mean of the time factor from start to end, which makes impulse and displacement exact."""
        return self.condition.mean_factor(start, end)

    def layer(self, low: Floats, high: Floats, x: Floats, depth: float) -> Bools:
        """Which atoms lie within ``depth`` of the outermost atoms of the face.

        Parameters
        ----------
        low, high : ndarray, shape ``(d,)``
            Extent of the atoms of all ranks.
        x : ndarray, shape ``(n, d)``
            Positions.
        """
        away = high[self.axis] - x[:, self.axis] if self.side else x[:, self.axis] - low[self.axis]
        inside: Bools = away < depth
        return inside


def rim_faces(plan: Plan, conditions: tuple[str, ...]) -> list[RimFace]:
    """Faces of the domain that the atoms reach and that have one of the conditions."""
    found = []
    interfaces = (
        [region.interfaces for region in plan.coupling.zones.regions] if plan.coupling else None
    )
    for axis in range(plan.dim):
        for side in range(2):
            sizes = [
                math.prod(high - low for other, (low, high) in enumerate(box) if other != axis)
                for number, box in enumerate(plan.atoms.regions)
                if interfaces is None or not interfaces[number][axis][side]
            ]
            face = plan.boundary.face(axis, side)
            if face.condition in conditions and sizes:
                found.append(RimFace(axis, side, face, sum(sizes)))
    return found


class Loads:
    """Tractions and prescribed velocities of the atoms of one rank, and their work.

    A traction acts as equal forces on the atoms within half a spacing of the outermost ones. A
    prescribed velocity acts on the atoms within one cutoff of the outermost ones, so that free
    atoms feel no surface there.

    Parameters
    ----------
    plan : Plan
    atoms : Atoms
        At their lattice positions.
    spacing : float
        Distance of neighbouring atoms.

    Attributes
    ----------
    held : list of int
        For each axis the role bits of the atoms with a prescribed component along it.
    loaded : int
        Role bits of the atoms that carry a traction.
    work : float
        Work on the atoms of this rank since the start (energy units).
    """

    def __init__(self, plan: Plan, atoms: Atoms, spacing: float) -> None:
        self._plan, self._atoms, self._spacing = plan, atoms, spacing
        self._tractions = rim_faces(plan, ("traction",))
        self._prescribed = rim_faces(plan, ("velocity", "symmetry"))
        self._period = periods(plan.background_grid())
        self._force: dict[str, Floats] = {}  # of a face on each of its atoms
        self.held = [
            sum(
                velocity_bit(face.axis, face.side)
                for face in self._prescribed
                if face.velocity(plan.dim)[axis] is not None
            )
            for axis in range(plan.dim)
        ]
        self.loaded = sum(traction_bit(face.axis, face.side) for face in self._tractions)
        self.work = 0.0

    def roles(self, free: Bools) -> Ints:
        """Role bits of the atoms that carry a traction or follow a velocity; collective.

        Parameters
        ----------
        free : ndarray of bool, shape ``(n,)``
            The atoms that do not follow the continuum.
        """
        atoms, x = self._atoms, self._atoms.site
        low, high = extent(atoms.comm, x)
        role = np.zeros(len(x), dtype=np.int64)
        for face in self._tractions:
            surface = face.layer(low, high, x, 0.5 * self._spacing)
            count = atoms.comm.allreduce(int(surface.sum()))
            self._force[face.name] = face.force(self._plan.units) / count
            role |= np.where(surface & free, traction_bit(face.axis, face.side), 0)
        for face in self._prescribed:
            layer = face.layer(low, high, x, atoms.cutoff)
            role |= np.where(layer & free, velocity_bit(face.axis, face.side), 0)
        return role

    def apply(self, start: float, end: float) -> None:
        """Set velocities and forces to their means over the coupling step from start to end."""
        atoms = self._atoms
        for face in self._prescribed:
            layer = self._having(velocity_bit(face.axis, face.side))
            factor = face.mean_factor(start, end)
            for axis, value in enumerate(face.velocity(self._plan.dim)):
                if value is not None:
                    self._set_velocity(layer, axis, value * factor)
        if self._tractions:
            atoms.external[:] = 0.0
        for face in self._tractions:
            surface = self._having(traction_bit(face.axis, face.side))
            atoms.external[surface] += face.mean_factor(start, end) * self._force[face.name]

    def add_work_of_motion(self, span: float) -> None:
        """Add the work of prescribed velocities over a time, with the present forces."""
        v, f = self._atoms.v, self._atoms.f
        for axis, bits in enumerate(self.held):
            if bits:
                held = self._in_core(self._having(bits))
                self.work -= span * float((v[held, axis] * f[held, axis]).sum())

    def add_work_of_tractions(self, start: float, end: float) -> None:
        """Add the work of the tractions on the path from ``atoms.last`` to ``atoms.x``."""
        x, last = self._atoms.x, self._atoms.last
        for face in self._tractions:
            surface = self._in_core(self._having(traction_bit(face.axis, face.side)))
            path = np.empty((surface.size, x.shape[1]))
            mean_velocity(x[surface], last[surface], self._period, 1.0, path)
            mean = face.mean_factor(start, end)
            self.work += mean * float((path.sum(axis=0) * self._force[face.name]).sum())

    def _set_velocity(self, layer: Ints, axis: int, value: float) -> None:
        """Change a component of the velocity, and add the change of kinetic energy to the work."""
        v, m = self._atoms.v, self._atoms.mass
        jump = value**2 - v[layer, axis] ** 2
        v[layer, axis] = value
        core = (self._atoms.role[layer] & np.int32(CORE)) != 0
        gained = 0.5 * float((m[layer] * jump)[core].sum())
        self.work += UNITS[self._plan.units].energy_from_mechanical(gained)

    def _having(self, bits: int) -> Ints:
        """Rows of the atoms that have one of the role bits."""
        return np.flatnonzero(self._atoms.role & np.int32(bits))

    def _in_core(self, rows: Ints) -> Ints:
        """Those rows whose atoms count in the energy, and so in the work."""
        return rows[(self._atoms.role[rows] & np.int32(CORE)) != 0]

"""Conditions on the faces of MD regions that lie on the rim of the domain: tractions and springs.

A traction acts as equal forces on the outermost atoms of a face. Where a motion is prescribed, each
of the outermost atoms hangs on a spring from the face, which moves as prescribed. The spring stands
for the material between the atom and the face: the outermost atoms lie half a spacing inside the
face, and the body reaches up to the face. So a body of atoms is as stiff as the same body of the
continuum. If the outermost atoms themselves moved as prescribed, it would be stiffer, as it would
be shorter by half a spacing at each end.

The material of the springs is strained along the face too, where the prescribed motion changes
along it. Its share of the traction is an external force. An initial strain is balanced exactly: the
atoms within reach of the face get the constant forces that hold them in the strained crystal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimpmd_md.engines.atoms import Atoms, Spring
from gimpmd_md.roles import CORE, PRELOADED, part_bit
from gimpmd_md.sums import extent, mean_velocity, periods
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.case.face_parts import FacePart
from gimpmd_schemas.case.initial_state import initial_state
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.mechanics.elasticity import christoffel, traction
from gimpmd_schemas.mechanics.units import UNITS

TRACTION_LAYER = 0.5
"""Depth of the atoms that carry a traction, from the outermost ones (spacings)."""

SPRING_LAYER = 0.75
"""Depth of the atoms that hang on springs, from the outermost ones (spacings).

This is one layer of a dense face, and both layers of a face whose atoms stand in zigzag.
"""

DIFFERENCE = 1e-3
"""Distance over which a prescribed motion is differentiated (spacings)."""

LEAST_DEPTH = 0.1
"""Least length of a spring (spacings), for atoms that lie on the face itself."""


@dataclass(frozen=True)
class RimPart:
    """A part of a face of the domain that the atoms reach.

    Attributes
    ----------
    part : FacePart
    bit : int
        Role bit of its atoms.
    size : float
        Length of the part in two dimensions, area in three; of all regions together.
    """

    part: FacePart
    bit: int
    size: float

    def layer(self, low: Floats, high: Floats, x: Floats, depth: float) -> Bools:
        """Which atoms of the part lie within ``depth`` of the outermost atoms of the face.

        Parameters
        ----------
        low, high : ndarray, shape ``(d,)``
            Extent of the atoms of all ranks.
        x : ndarray, shape ``(n, d)``
            Positions.
        """
        axis = self.part.axis
        away = high[axis] - x[:, axis] if self.part.side else x[:, axis] - low[axis]
        return np.asarray((away < depth) & self.part.covers(x))

    def on_face(self, x: Floats) -> Floats:
        """Positions ``(n, d)``, moved along the normal onto the face."""
        x = x.copy()
        x[:, self.part.axis] = self.part.domain[self.part.axis][self.part.side]
        return x


def rim_parts(plan: Plan, conditions: tuple[str, ...]) -> list[RimPart]:
    """Parts of the faces that the atoms reach and that have one of the conditions."""
    found = []
    interfaces = (
        [region.interfaces for region in plan.coupling.zones.regions] if plan.coupling else None
    )
    for place, part in enumerate(plan.face_parts()):
        size = sum(
            part.overlap(box)
            for number, box in enumerate(plan.atoms.regions)
            if interfaces is None or not interfaces[number][part.axis][part.side]
        )
        if part.condition.condition in conditions and size > 0.0:
            found.append(RimPart(part, part_bit(place), size))
    return found


class Loads:
    """Conditions on the atoms of one rank, and their work.

    Parameters
    ----------
    plan : Plan
    atoms : Atoms
        At their lattice positions.
    spacing : float
        Distance of neighbouring atoms.

    Attributes
    ----------
    loaded : int
        Role bits of the atoms on which external forces act.
    springs : list of Spring
        For each part and each prescribed component. Known after `roles`.
    work : float
        Work on the atoms of this rank since the start (energy units).
    """

    def __init__(self, plan: Plan, atoms: Atoms, spacing: float) -> None:
        self._plan, self._atoms, self._spacing = plan, atoms, spacing
        self._tractions = rim_parts(plan, ("traction",))
        self._driven = rim_parts(plan, ("velocity", "displacement", "symmetry"))
        self._period = periods(plan.background_grid())
        self._area: dict[int, float] = {}  # of each loaded atom, in pressure units, by bits
        self._stiffness: dict[int, Floats] = {}  # of the springs of an atom along each axis
        self._on_springs = sum(rim.bit for rim in self._driven)
        self.loaded = sum(rim.bit for rim in self._tractions) | self._on_springs
        self.loaded |= PRELOADED if self._driven else 0
        self.springs: list[Spring] = []
        self.work = 0.0

    def roles(self, free: Bools) -> Ints:
        """Role bits of the atoms that carry a traction or hang on springs; collective.

        Parameters
        ----------
        free : ndarray of bool, shape ``(n,)``
            The atoms that do not follow the continuum.
        """
        atoms, x = self._atoms, self._atoms.site
        low, high = extent(atoms.comm, x)
        role = np.zeros(len(x), dtype=np.int64)
        for rim in self._tractions:
            layer = rim.layer(low, high, x, TRACTION_LAYER * self._spacing)
            self._area[rim.bit] = self._area_of_atom(rim, layer)
            role |= np.where(layer & free, rim.bit, 0)
        for rim in self._driven:
            layer = rim.layer(low, high, x, SPRING_LAYER * self._spacing)
            self._area[rim.bit] = self._area_of_atom(rim, layer)
            self._make_springs(rim, x, layer)
            within = rim.layer(low, high, x, self._reach)
            role |= np.where(layer & free, rim.bit, 0) | np.where(within & free, PRELOADED, 0)
        return role

    def balance(self) -> None:
        """Balance the present forces on atoms near driven faces by constant ones; collective.

        The atoms that would lie outside the face are missing. In their place the constant forces
        hold a perfect crystal at rest, and a crystal with an initial strain.
        """
        if not self._driven:
            return
        atoms, x = self._atoms, self._atoms.site
        low, high = extent(atoms.comm, x)
        rows = (atoms.role & np.int32(PRELOADED)) != 0
        for rim in self._driven:
            within = rows & rim.layer(low, high, x, self._reach)
            for axis, value in enumerate(rim.part.components):
                if value is not None:
                    atoms.preload[within, axis] = -atoms.f[within, axis]

    def apply(self, start: float, end: float) -> None:
        """Set external forces to their means over the coupling step from start to end."""
        if not self.loaded:
            return
        external, site = self._atoms.external, self._atoms.site
        held = self._having(self._on_springs | PRELOADED)
        before = external[held].copy()
        external[:] = 0.0
        if self._driven:
            external[held] = self._atoms.preload[held]
        for rim in self._tractions:
            rows = self._having(rim.bit)
            external[rows] += self._traction(rim, site[rows], start, end)
        for rim in self._driven:
            rows = self._having(rim.bit)
            external[rows] += self._pull(rim, site[rows], 0.5 * (start + end))
        # the first half kick of the step takes the forces of the last one: they follow the face
        self._atoms.f[held] += external[held] - before

    def note_positions(self) -> None:
        """Store where the path of the loaded atoms begins."""
        if self.loaded:
            rows = self._having(self.loaded)
            self._atoms.last[rows] = self._atoms.x[rows]

    def add_work(self) -> None:
        """Add the work on the path from ``atoms.last`` to ``atoms.x``; exact for springs too."""
        if not self.loaded:
            return
        x, last, rest = self._atoms.x, self._atoms.last, self._atoms.rest
        rows = self._in_core(self._having(self.loaded))
        self.work += float((self._path(x, last, rows) * self._atoms.external[rows]).sum())
        for rim in self._driven:
            rows = self._in_core(self._having(rim.bit))
            path, moved = self._path(x, last, rows), self._path(x, rest, rows)
            self.work -= float((path * self._stiffness[rim.bit] * (moved - 0.5 * path)).sum())

    def _area_of_atom(self, rim: RimPart, layer: Bools) -> float:
        """Area of the part for each of its atoms, times what makes a force of a pressure."""
        count = self._atoms.comm.allreduce(int(layer.sum()))
        return rim.size / UNITS[self._plan.units].nktv2p / max(count, 1)

    def _make_springs(self, rim: RimPart, x: Floats, layer: Bools) -> None:
        """Springs as stiff as the material between the atoms of a layer and the face."""
        plan, axis, comm = self._plan, rim.part.axis, self._atoms.comm
        away = np.abs(x[layer, axis] - rim.part.domain[axis][rim.part.side])
        count = max(comm.allreduce(int(layer.sum())), 1)
        depth = max(comm.allreduce(float(away.sum())) / count, LEAST_DEPTH * self._spacing)
        moduli = np.diag(christoffel(plan.stiffness(), axis))
        held = np.zeros(plan.dim)
        for component, value in enumerate(rim.part.components):
            if value is not None:
                held[component] = moduli[component] * self._area[rim.bit] / depth
                self.springs.append(Spring(rim.bit, component, float(held[component])))
        self._stiffness[rim.bit] = held

    def _traction(self, rim: RimPart, site: Floats, start: float, end: float) -> Floats:
        """Mean force ``(n, d)`` on atoms that carry a traction."""
        factor = rim.part.condition.mean_factor(start, end)
        return factor * self._area[rim.bit] * rim.part.value(rim.on_face(site))

    def _pull(self, rim: RimPart, site: Floats, time: float) -> Floats:
        """Force ``(n, d)`` on atoms at rest by a face that has moved."""
        face, condition = rim.on_face(site), rim.part.condition
        pull = np.zeros_like(site)
        if condition.condition in ("velocity", "displacement"):
            moving = condition.condition == "velocity"
            factor = condition.integral(time) if moving else condition.factor(time)
            pull += factor * self._stiffness[rim.bit] * rim.part.value(face)
            pull += factor * self._area[rim.bit] * self._traction_along(rim, face)
        if self._plan.initial.packets and self._plan.initial.stretch is None:
            pull += self._stiffness[rim.bit] * initial_state(self._plan, face)[0]
        return pull

    def _traction_along(self, rim: RimPart, face: Floats) -> Floats:
        """Traction ``(n, d)`` where the full value of a part strains the face along itself."""
        part = rim.part
        if isinstance(part.condition.value, tuple):  # the same everywhere
            return np.zeros_like(face)
        gradient = np.zeros((*face.shape, face.shape[1]))
        step = DIFFERENCE * self._spacing
        for axis, e in enumerate(step * np.eye(face.shape[1])):
            if axis != part.axis:
                difference = part.value(face + e) - part.value(face - e)
                gradient[:, :, axis] = difference / (2.0 * step)
        held = np.array([value is not None for value in part.components])
        outward = 1.0 if part.side else -1.0
        return np.where(held, outward * traction(part.stiffness, part.axis, gradient), 0.0)

    @property
    def _reach(self) -> float:
        """Depth of the atoms on which atoms outside the face would act."""
        return self._atoms.cutoff * (1.0 if self._atoms.pairwise else 2.0)

    def _path(self, x: Floats, start: Floats, rows: Ints) -> Floats:
        """Displacement ``(n, d)`` of some atoms from one position to another (minimum image)."""
        path = np.empty((rows.size, x.shape[1]))
        mean_velocity(x[rows], start[rows], self._period, 1.0, path)
        return path

    def _having(self, bits: int) -> Ints:
        """Rows of the atoms that have one of the role bits."""
        return np.flatnonzero(self._atoms.role & np.int32(bits))

    def _in_core(self, rows: Ints) -> Ints:
        """Those rows whose atoms count in the energy, and so in the work."""
        return rows[(self._atoms.role[rows] & np.int32(CORE)) != 0]

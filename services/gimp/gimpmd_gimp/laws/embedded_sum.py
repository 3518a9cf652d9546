"""Hyperelasticity of a crystal of embedded atoms: the energy is the exact sum over neighbours."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from gimpmd_gimp.laws.law import TRUSTED, History, LawMakers, fastest_wave, kernel
from gimpmd_gimp.laws.thermal import stress_of_plan
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.materials import EmbeddedLattice
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.mechanics.elasticity import voigt_place
from gimpmd_schemas.mechanics.splines import cubics
from gimpmd_schemas.mechanics.units import UNITS

Table = tuple[Floats, float]
"""Cubics of a table (`splines.cubics`), and the distance of its points."""

Rest = tuple[float, Floats]
"""Energy and second Piola-Kirchhoff stress that are subtracted."""


@dataclass(frozen=True, eq=False)
class EmbeddedSum:
    """``W(F) = (U(sum_b 2 rho(r_b)) + sum_b phi(r_b)) / V``, ``r_b = |F R_b|``, in space.

    This is the law of Cauchy and Born for one atom in the primitive cell, of volume V. U is the
    energy of an atom in the density of its neighbours, phi that of a pair. The sums have one of
    each two opposite neighbours. With LAMMPS's own tables and splines, the stress is that of
    LAMMPS to round-off.

    The energy of the crystal at rest is subtracted, and its stress as in `LatticeSum`: without a
    thermal stress the body is free of stress at rest. Unlike other laws of crystals, this one has
    no continuation: at large strains the crystal softens and breaks as that of the atoms does.

    Attributes
    ----------
    density : float
        Mass per reference volume.
    stiffness : ndarray, shape ``(6, 6)``
        At rest (mechanical units); for the speed of waves only.
    volume : float
        Volume of the primitive cell.
    bonds : ndarray, shape ``(m, 3)``
        Vectors R_b to neighbours at rest, one of each two opposite ones.
    cutoff : float
        Distance at which the tables end.
    pair, cloud, embedding : Table
        ``r phi(r)``, ``rho(r)``, and U of the density (mechanical units).
    thermal : ndarray, shape ``(6,)``, optional
        Thermal stress, in Voigt order. None: the body is free of stress at rest.
    """

    density: float
    stiffness: Floats
    volume: float
    bonds: Floats
    cutoff: float
    pair: Table
    cloud: Table
    embedding: Table
    thermal: Floats | None = None
    _rest: Rest = field(init=False, repr=False)

    name: ClassVar[str] = "Cauchy-Born, embedded atoms"
    finite: ClassVar[bool] = True
    history: ClassVar[History] = ()

    def __post_init__(self) -> None:
        for array in (self.bonds, self.pair[0], self.cloud[0], self.embedding[0]):
            array.flags.writeable = False
        one, free = (np.zeros(1, np.int64), 0, 1, np.eye(3)[None]), (0.0, _read_only((3, 3)))
        W, tau = np.empty(1), np.empty((1, 3, 3))
        _energy(*one, *self._sum, free, W)
        _stress(*one, *self._sum, free, tau)
        if self.thermal is not None:
            tau[0] = -self.thermal[voigt_place(3)]
        stress = _read_only((3, 3), tau[0])
        object.__setattr__(self, "_rest", (float(W[0]), stress))

    @property
    def _sum(self) -> tuple[Floats, float, float, Table, Table, Table]:
        return self.bonds, self.volume, self.cutoff, self.pair, self.cloud, self.embedding

    def stress(
        self, order: Ints, first: int, last: int, F: Floats, history: Floats, out: Floats
    ) -> None:
        """Kirchhoff stress; see `Law`."""
        _stress(order, first, last, F, *self._sum, self._rest, out)

    def energy(
        self, order: Ints, first: int, last: int, F: Floats, history: Floats, out: Floats
    ) -> None:
        """Strain energy, zero at rest; see `Law`."""
        _energy(order, first, last, F, *self._sum, self._rest, out)

    def wave_speed(self) -> float:
        """Speed of the fastest wave at rest, over all directions."""
        return fastest_wave(self.stiffness, self.density)

    @property
    def trusted_strain(self) -> float:
        """Strain of a crystal that is about to break; see `Law`."""
        return TRUSTED


def from_material(material: EmbeddedLattice, plan: Plan) -> EmbeddedSum:
    """Law of a material ``from: embedded``, with its thermal stress if there is a temperature."""
    units = UNITS[plan.units]
    energy, step = units.energy_to_mechanical(1.0), material.distance_step
    return EmbeddedSum(
        density=material.density,
        stiffness=units.stress_to_mechanical(1.0) * plan.stiffness(),
        volume=material.volume,
        bonds=np.array(material.bonds),
        cutoff=material.cutoff,
        pair=(energy * cubics(_numbers(material.pair)), step),
        cloud=(cubics(_numbers(material.cloud)), step),
        embedding=(energy * cubics(_numbers(material.embedding)), material.density_step),
        thermal=None if plan.continuum.temperature is None else stress_of_plan(plan),
    )


MATERIALS: LawMakers = {EmbeddedLattice: from_material}


def _numbers(table: bytes) -> Floats:
    return np.frombuffer(table, dtype="<f8")


def _read_only(shape: tuple[int, ...], values: Floats | float = 0.0) -> Floats:
    """A protected array; a kernel is compiled once more for an array that can be written."""
    array = np.zeros(shape)
    array[:] = values
    array.flags.writeable = False
    return array


@kernel
def _look_up(table: Table, x: float) -> tuple[float, float]:
    """Value and slope at x; see `splines.interpolate`."""
    cubic, per = table[0], 1.0 / table[1]
    place = x * per
    at = np.uint64(min(max(int(place), 0), cubic.shape[0] - 1))
    part = min(place - at, 1.0)
    a, b, c, d = cubic[at, 0], cubic[at, 1], cubic[at, 2], cubic[at, 3]
    return ((a * part + b) * part + c) * part + d, ((3.0 * a * part + 2.0 * b) * part + c) * per


@kernel
def _neighbour(F: Floats, p: int, bonds: Floats, b: int, x: Floats) -> float:
    """Write the vector of a deformed bond to ``x (3,)``, and return its length."""
    square = 0.0
    for i in range(3):
        x[i] = F[p, i, 0] * bonds[b, 0] + F[p, i, 1] * bonds[b, 1] + F[p, i, 2] * bonds[b, 2]
        square += x[i] * x[i]
    return np.sqrt(square)


@kernel
def _stress(
    order: Ints,
    first: int,
    last: int,
    F: Floats,
    bonds: Floats,
    volume: float,
    cutoff: float,
    pair: Table,
    cloud: Table,
    embedding: Table,
    rest: Rest,
    out: Floats,
) -> None:
    x = np.empty((bonds.shape[0], 3))
    pull, push = np.empty(bonds.shape[0]), np.empty(bonds.shape[0])  # slopes over the length
    for k in range(first, last):
        p = np.uint64(order[k])  # unsigned: no test for indices from the end
        around, count = 0.0, 0
        for b in range(bonds.shape[0]):
            r = _neighbour(F, p, bonds, b, x[count])
            if r < cutoff:
                over = 1.0 / r
                value, slope = _look_up(cloud, r)
                around += 2.0 * value
                pull[count] = 2.0 * slope * over
                value, slope = _look_up(pair, r)
                push[count] = (slope - value * over) * over * over
                count += 1
        _, deep = _look_up(embedding, around)
        xx, yy, zz, yz, xz, xy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for b in range(count):
            g, x0, x1, x2 = (deep * pull[b] + push[b]) / volume, x[b, 0], x[b, 1], x[b, 2]
            xx += g * x0 * x0
            yy += g * x1 * x1
            zz += g * x2 * x2
            yz += g * x1 * x2
            xz += g * x0 * x2
            xy += g * x0 * x1
        tau = ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
        for i in range(3):
            for j in range(i + 1):
                left = tau[i][j]
                for a in range(3):
                    for b in range(3):
                        left -= F[p, i, a] * rest[1][a, b] * F[p, j, b]
                out[p, i, j] = left
                out[p, j, i] = left


@kernel
def _energy(
    order: Ints,
    first: int,
    last: int,
    F: Floats,
    bonds: Floats,
    volume: float,
    cutoff: float,
    pair: Table,
    cloud: Table,
    embedding: Table,
    rest: Rest,
    out: Floats,
) -> None:
    x = np.empty(3)
    for k in range(first, last):
        p = np.uint64(order[k])
        around, pairs = 0.0, 0.0
        for b in range(bonds.shape[0]):
            r = _neighbour(F, p, bonds, b, x)
            if r < cutoff:
                around += 2.0 * _look_up(cloud, r)[0]
                pairs += _look_up(pair, r)[0] / r
        W = (_look_up(embedding, around)[0] + pairs) / volume - rest[0]
        for a in range(3):
            for b in range(3):
                c = -1.0 if a == b else 0.0
                for i in range(3):
                    c += F[p, i, a] * F[p, i, b]
                W -= 0.5 * rest[1][a, b] * c
        out[p] = W

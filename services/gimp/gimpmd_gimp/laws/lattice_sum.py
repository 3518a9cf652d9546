"""Hyperelasticity of a plane crystal with pair bonds: the energy is a sum over bonds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from gimpmd_gimp.laws.law import TRUSTED, History, LawMakers, fastest_wave, kernel
from gimpmd_gimp.laws.thermal import stress_of_plan
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.materials import PairLattice
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.mechanics.units import UNITS

LANES = 64
"""Points that are evaluated together, so that the processor's vector units are used."""

UNROLLED = 4
"""Steps of Horner's scheme that are unrolled; polynomials are padded to a multiple of it."""

VALUE, SLOPE, CURVATURE = 0, 1, 2
"""Rows of the table of polynomials."""


@dataclass(frozen=True, eq=False)
class LatticeSum:
    """``W(F) = (1 / A) sum_b phi_b(s_b)``, ``s_b = |F R_b|^2 / |R_b|^2``, in two dimensions.

    This is the law of Cauchy and Born for a lattice with one atom in its primitive cell, of area
    A. Bonds deform as the body does. The sum has one of each two opposite bonds. The squared
    stretch, ``s_b - 1 = 2 R_b . E R_b / |R_b|^2``, is linear in the Green-Lagrange strain E, so

        S = dW/dE = (1 / A) sum_b phi_b'(s_b) 2 R_b R_b^T / |R_b|^2,   tau = F S F^T.

    Where ``|s_b - 1|`` exceeds the limit, the energy of a bond continues quadratically. Without a
    thermal stress, the stress of the bonds at rest is subtracted, so that the body is free of
    stress at rest. With a thermal stress it is kept, and ``thermal : E`` is added to ``W``, so that
    a body without loads expands.

    Attributes
    ----------
    density : float
        Mass per reference area.
    area : float
        Area of the primitive cell.
    bonds : ndarray, shape ``(m, 2)``
        Vectors R_b to neighbours at rest, one of each two opposite ones.
    coefficients : sequence of m sequences
        Coefficients ``c_1, c_2, ...`` of ``phi_b = sum_k c_k (s_b - 1)^k`` (mechanical units).
    stretch_limit : float
        ``|s_b - 1|`` up to which these polynomials hold.
    thermal : ndarray, shape ``(3,)``, optional
        Stress of the crystal's vibrations (`thermal_stress`), in Voigt order. None: the body is
        free of stress at rest.
    """

    density: float
    area: float
    bonds: Floats
    coefficients: Sequence[Sequence[float]]
    stretch_limit: float
    thermal: Floats | None = None
    _strain: Floats = field(
        init=False, repr=False
    )  # one row per bond: s_b - 1 = row . E in Voigt order
    _powers: Floats = field(init=False, repr=False)  # see `_polynomials`
    _rest: Floats = field(init=False, repr=False)  # stress that is subtracted

    name: ClassVar[str] = "Cauchy-Born, lattice sum"
    finite: ClassVar[bool] = True
    history: ClassVar[History] = ()

    def __post_init__(self) -> None:
        x, y = np.array(self.bonds, dtype=float).T
        strain = 2.0 * np.column_stack([x * x, y * y, x * y]) / (x * x + y * y)[:, None]
        tables = _read_only(strain), _read_only(_polynomials(self.coefficients, self.area))
        if self.thermal is None:
            one, tau = (np.zeros(1, np.int64), 0, 1, np.eye(2)[None]), np.empty((1, 2, 2))
            _stress(*one, *tables, self.stretch_limit, _read_only(np.zeros(3)), tau)
            rest = np.array([tau[0, 0, 0], tau[0, 1, 1], tau[0, 0, 1]])
        else:
            rest = np.negative(self.thermal)
        for name, table in zip(
            ("_strain", "_powers", "_rest"), (*tables, _read_only(rest)), strict=True
        ):
            object.__setattr__(self, name, table)

    def stress(
        self, order: Ints, first: int, last: int, F: Floats, history: Floats, out: Floats
    ) -> None:
        """Kirchhoff stress; see `Law`."""
        _stress(
            order, first, last, F, self._strain, self._powers, self.stretch_limit, self._rest, out
        )

    def energy(
        self, order: Ints, first: int, last: int, F: Floats, history: Floats, out: Floats
    ) -> None:
        """Strain energy, zero at rest; see `Law`."""
        _energy(
            order, first, last, F, self._strain, self._powers, self.stretch_limit, self._rest, out
        )

    def wave_speed(self) -> float:
        """Speed of the fastest wave at rest, over all directions.

        Waves are faster in a compressed crystal, which is stiffer.
        """
        curvature = self._powers[CURVATURE, :, -1]
        return fastest_wave(self._strain.T * curvature @ self._strain, self.density)

    @property
    def trusted_strain(self) -> float:
        """Strain of a crystal that is about to break, or the limit of the polynomials; see `Law`.

        A strain E changes ``s_b`` by ``2 |E|`` at most.
        """
        return max(TRUSTED, 0.5 * self.stretch_limit)


def from_material(material: PairLattice, plan: Plan) -> LatticeSum:
    """Law of a material ``from: lattice``, with its thermal stress if there is a temperature."""
    bonds, area = np.array(material.bonds), material.area
    mechanical = UNITS[plan.units].energy_to_mechanical
    energy = [[mechanical(c) for c in bond] for bond in material.energy]
    thermal = None if plan.continuum.temperature is None else stress_of_plan(plan)
    return LatticeSum(material.density, area, bonds, energy, material.stretch_limit, thermal)


MATERIALS: LawMakers = {PairLattice: from_material}


def _read_only(table: Floats) -> Floats:
    """Protect an array; a kernel is compiled once more for an array that can be written."""
    table.flags.writeable = False
    return table


def _polynomials(coefficients: Sequence[Sequence[float]], area: float) -> Floats:
    """Coefficients of ``phi / (s - 1)``, of phi' and of phi'', each divided by the area.

    Returns
    -------
    ndarray, shape ``(3, m, n)``
        Rows VALUE, SLOPE and CURVATURE for every bond, highest power first. n is a multiple of
        ``UNROLLED``.
    """
    longest = max(map(len, coefficients))
    table = np.zeros((3, len(coefficients), -(-longest // UNROLLED) * UNROLLED))
    for b, c in enumerate(coefficients):
        slope = np.arange(1, len(c) + 1) * c / area
        for row, numbers in (
            (VALUE, np.array(c) / area),
            (SLOPE, slope),
            (CURVATURE, np.arange(1, len(c)) * slope[1:]),
        ):
            table[row, b, table.shape[2] - len(numbers) :] = numbers[::-1]
    return table


@kernel
def _strains(order: Ints, first: int, count: int, F: Floats, E: Floats) -> None:
    """Write the Green-Lagrange strains of ``count`` points to ``E (3, LANES)``, in Voigt order."""
    for lane in range(count):
        p = np.uint64(order[first + lane])  # unsigned: no test for indices from the end
        xx, xy = F[p, 0, 0] - 1.0, F[p, 0, 1]  # F - I, so that small strains keep their digits
        yx, yy = F[p, 1, 0], F[p, 1, 1] - 1.0
        E[0, lane] = xx + 0.5 * (xx * xx + yx * yx)
        E[1, lane] = yy + 0.5 * (xy * xy + yy * yy)
        E[2, lane] = xy + yx + xx * xy + yx * yy


@kernel
def _stretches(E: Floats, strain: Floats, z: Floats, most: Floats) -> float:
    """Write ``s_b - 1`` of every bond and lane to ``z (m, LANES)``; return the largest ``|z|``."""
    most[:] = 0.0
    for b in range(strain.shape[0]):
        x, y, xy = strain[b, 0], strain[b, 1], strain[b, 2]
        for lane in range(LANES):
            z[b, lane] = x * E[0, lane] + y * E[1, lane] + xy * E[2, lane]
            most[lane] = max(most[lane], abs(z[b, lane]))
    largest = 0.0
    for lane in range(LANES):
        largest = max(largest, most[lane])
    return largest


@kernel
def _cut(z: Floats, limit: float, ahead: Floats) -> None:
    """Clip ``z (LANES,)`` at the limit; write the excess, zero within it, to ``ahead``."""
    for lane in range(LANES):
        cut = min(max(z[lane], -limit), limit)
        ahead[lane] = z[lane] - cut
        z[lane] = cut


@kernel
def _evaluate(c: Floats, z: Floats, p: Floats) -> None:
    """Write the polynomial with coefficients ``c (n,)`` at ``z (LANES,)`` to ``p``, by Horner."""
    p[:] = 0.0
    for k in range(0, c.size, UNROLLED):
        c0, c1, c2, c3 = c[k], c[k + 1], c[k + 2], c[k + 3]
        for lane in range(LANES):
            p[lane] = (((p[lane] * z[lane] + c0) * z[lane] + c1) * z[lane] + c2) * z[lane] + c3


@kernel
def _stress(
    order: Ints,
    first: int,
    last: int,
    F: Floats,
    strain: Floats,
    powers: Floats,
    limit: float,
    rest: Floats,
    out: Floats,
) -> None:
    E, S, z = np.zeros((3, LANES)), np.zeros((3, LANES)), np.zeros((strain.shape[0], LANES))
    p, q, ahead = np.zeros(LANES), np.zeros(LANES), np.zeros(LANES)
    for begin in range(first, last, LANES):
        count = min(LANES, last - begin)
        _strains(order, begin, count, F, E)
        beyond = _stretches(E, strain, z, p) > limit
        S[:] = 0.0
        for bond in range(strain.shape[0]):
            if beyond:  # adds exactly zero within: a point does not depend on its neighbours
                _cut(z[bond], limit, ahead)
                _evaluate(powers[CURVATURE, bond], z[bond], q)
            _evaluate(powers[SLOPE, bond], z[bond], p)
            if beyond:
                for lane in range(LANES):
                    p[lane] += ahead[lane] * q[lane]
            for v in range(3):
                share = strain[bond, v]
                for lane in range(LANES):
                    S[v, lane] += share * p[lane]
        for lane in range(count):
            i = np.uint64(order[begin + lane])
            xx, yy, xy = S[0, lane] - rest[0], S[1, lane] - rest[1], S[2, lane] - rest[2]
            a, b, c, d = F[i, 0, 0], F[i, 0, 1], F[i, 1, 0], F[i, 1, 1]
            shear = (a * xx + b * xy) * c + (a * xy + b * yy) * d
            out[i, 0, 0] = (a * xx + b * xy) * a + (a * xy + b * yy) * b
            out[i, 1, 1] = (c * xx + d * xy) * c + (c * xy + d * yy) * d
            out[i, 0, 1] = shear
            out[i, 1, 0] = shear


@kernel
def _energy(
    order: Ints,
    first: int,
    last: int,
    F: Floats,
    strain: Floats,
    powers: Floats,
    limit: float,
    rest: Floats,
    out: Floats,
) -> None:
    E, W, z = np.zeros((3, LANES)), np.zeros(LANES), np.zeros((strain.shape[0], LANES))
    w, p, q, ahead = np.zeros(LANES), np.zeros(LANES), np.zeros(LANES), np.zeros(LANES)
    for begin in range(first, last, LANES):
        count = min(LANES, last - begin)
        _strains(order, begin, count, F, E)
        beyond = _stretches(E, strain, z, p) > limit
        for lane in range(LANES):
            W[lane] = -rest[0] * E[0, lane] - rest[1] * E[1, lane] - rest[2] * E[2, lane]
        for bond in range(strain.shape[0]):
            if beyond:
                _cut(z[bond], limit, ahead)
                _evaluate(powers[SLOPE, bond], z[bond], p)
                _evaluate(powers[CURVATURE, bond], z[bond], q)
            _evaluate(powers[VALUE, bond], z[bond], w)
            for lane in range(LANES):
                W[lane] += w[lane] * z[bond, lane]
            if beyond:
                for lane in range(LANES):
                    W[lane] += ahead[lane] * (p[lane] + 0.5 * ahead[lane] * q[lane])
        for lane in range(count):
            out[order[begin + lane]] = W[lane]

"""Compressible neo-Hookean elasticity."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from gimpmd_gimp.laws.law import History, by_dimension, kernel, squared
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.materials import Elastic
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.mechanics.units import UNITS


@dataclass(frozen=True)
class NeoHookean:
    """``tau = lame ln(J) I + shear (F F^T - I)``.

    In two dimensions this is plane strain, with F33 = 1. It is the law of the manufactured
    solutions of Wallstedt and Guilkey, J. Comput. Phys. 227 (2008) 9628.

    Attributes
    ----------
    density : float
        Mass per reference volume.
    lame, shear : float
        Lame's lambda and the shear modulus mu at small strain (mechanical units).
    """

    density: float
    lame: float
    shear: float

    name: ClassVar[str] = "neo-Hookean"
    finite: ClassVar[bool] = True
    history: ClassVar[History] = ()

    @classmethod
    def bar(cls, density: float, young: float) -> Self:
        """Law ``sigma = E/2 (F - 1/F)`` of a bar in one dimension, with a Poisson's ratio of 0."""
        return cls(density, 0.0, 0.5 * young)

    def stress(
        self, order: Ints, first: int, last: int, F: Floats, history: Floats, out: Floats
    ) -> None:
        """Kirchhoff stress, NaN where ``J <= 0``; see `Law`."""
        _STRESS[F.shape[1]](order, first, last, F, self.lame, self.shear, out)

    def energy(
        self, order: Ints, first: int, last: int, F: Floats, history: Floats, out: Floats
    ) -> None:
        """``lame / 2 ln(J)^2 - shear ln(J) + shear / 2 (F : F - d)``; see `Law`."""
        _ENERGY[F.shape[1]](order, first, last, F, self.lame, self.shear, out)

    def wave_speed(self) -> float:
        """Speed of longitudinal waves, ``sqrt((lame + 2 shear) / density)``."""
        return float(((self.lame + 2.0 * self.shear) / self.density) ** 0.5)

    @property
    def trusted_strain(self) -> float:
        """Strain at which a point is 1.41 times as long as at rest, or flat; see `Law`.

        The law is sound for any deformation without a fold, so the limit only tells of points that
        are torn or crushed.
        """
        return 0.5


def from_material(material: Elastic, plan: Plan) -> NeoHookean:
    """Law of a material ``from: moduli`` with ``model: neo-hookean``."""
    mechanical = UNITS[plan.units].stress_to_mechanical
    return NeoHookean(material.density, mechanical(material.lame), mechanical(material.shear))


@kernel
def _log_determinant(F: Floats, p: int, d: int) -> float:
    """``ln(det F)`` of point p."""
    if d == 1:
        return np.log(F[p, 0, 0])
    if d == 2:
        return np.log(F[p, 0, 0] * F[p, 1, 1] - F[p, 0, 1] * F[p, 1, 0])
    return np.log(
        F[p, 0, 0] * (F[p, 1, 1] * F[p, 2, 2] - F[p, 1, 2] * F[p, 2, 1])
        - F[p, 0, 1] * (F[p, 1, 0] * F[p, 2, 2] - F[p, 1, 2] * F[p, 2, 0])
        + F[p, 0, 2] * (F[p, 1, 0] * F[p, 2, 1] - F[p, 1, 1] * F[p, 2, 0])
    )


def _make_stress(d: int) -> Callable[..., None]:
    @kernel
    def stress(
        order: Ints, first: int, last: int, F: Floats, lame: float, shear: float, out: Floats
    ) -> None:
        for k in range(first, last):
            p = np.uint64(order[k])  # unsigned: no test for indices from the end
            pressure = lame * _log_determinant(F, p, d) - shear
            for i in range(d):
                for j in range(i + 1):
                    b = 0.0
                    for m in range(d):
                        b += F[p, i, m] * F[p, j, m]
                    out[p, i, j] = shear * b
                    out[p, j, i] = shear * b
                out[p, i, i] += pressure

    return stress


def _make_energy(d: int) -> Callable[..., None]:
    @kernel
    def energy(
        order: Ints, first: int, last: int, F: Floats, lame: float, shear: float, out: Floats
    ) -> None:
        for k in range(first, last):
            p = np.uint64(order[k])
            log_J = _log_determinant(F, p, d)
            square = -float(d)
            for i in range(d):
                for j in range(d):
                    square += squared(F[p, i, j])
            out[p] = 0.5 * lame * squared(log_J) - shear * log_J + 0.5 * shear * square

    return energy


_STRESS = by_dimension(_make_stress)
_ENERGY = by_dimension(_make_energy)

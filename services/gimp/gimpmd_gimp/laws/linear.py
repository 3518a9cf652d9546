"""Isotropic linear elasticity at small strains."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from gimpmd_gimp.laws.law import TRUSTED, History, by_dimension, kernel, squared
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.materials import Elastic
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.mechanics.units import UNITS


@dataclass(frozen=True)
class LinearElastic:
    """``tau = lame tr(eps) I + 2 shear eps`` with ``eps = sym(F) - I``.

    In two dimensions this is plane strain, or the law of a two-dimensional crystal.

    Attributes
    ----------
    density : float
        Mass per reference volume.
    lame, shear : float
        Lame's lambda and the shear modulus mu (mechanical units).
    """

    density: float
    lame: float
    shear: float

    name: ClassVar[str] = "linear elastic"
    finite: ClassVar[bool] = False
    history: ClassVar[History] = ()

    @classmethod
    def plane_stress(cls, density: float, lame: float, shear: float) -> Self:
        """Law of a thin plate in two dimensions, from its three-dimensional density and moduli."""
        return cls(density, 2.0 * lame * shear / (lame + 2.0 * shear), shear)

    def stress(
        self, order: Ints, first: int, last: int, F: Floats, history: Floats, out: Floats
    ) -> None:
        """Kirchhoff stress; see `Law`."""
        _STRESS[F.shape[1]](order, first, last, F, self.lame, self.shear, out)

    def energy(
        self, order: Ints, first: int, last: int, F: Floats, history: Floats, out: Floats
    ) -> None:
        """``lame / 2 tr(eps)^2 + shear eps : eps``; see `Law`."""
        _ENERGY[F.shape[1]](order, first, last, F, self.lame, self.shear, out)

    def wave_speed(self) -> float:
        """Speed of longitudinal waves, ``sqrt((lame + 2 shear) / density)``."""
        return float(((self.lame + 2.0 * self.shear) / self.density) ** 0.5)

    @property
    def trusted_strain(self) -> float:
        """Strain up to which small strains are small; see `Law`."""
        return TRUSTED


def from_material(material: Elastic, plan: Plan) -> LinearElastic:
    """Law of a material ``from: moduli`` with ``model: linear``."""
    mechanical = UNITS[plan.units].stress_to_mechanical
    make = LinearElastic.plane_stress if material.plane == "stress" else LinearElastic
    return make(material.density, mechanical(material.lame), mechanical(material.shear))


def _make_stress(d: int) -> Callable[..., None]:
    @kernel
    def stress(
        order: Ints, first: int, last: int, F: Floats, lame: float, shear: float, out: Floats
    ) -> None:
        for k in range(first, last):
            p = np.uint64(order[k])  # unsigned: no test for indices from the end
            trace = -float(d)
            for i in range(d):
                trace += F[p, i, i]
            for i in range(d):
                out[p, i, i] = lame * trace + 2.0 * shear * (F[p, i, i] - 1.0)
                for j in range(i):
                    tau = shear * (F[p, i, j] + F[p, j, i])
                    out[p, i, j] = tau
                    out[p, j, i] = tau

    return stress


def _make_energy(d: int) -> Callable[..., None]:
    @kernel
    def energy(
        order: Ints, first: int, last: int, F: Floats, lame: float, shear: float, out: Floats
    ) -> None:
        for k in range(first, last):
            p = np.uint64(order[k])
            trace, square = -float(d), 0.0
            for i in range(d):
                trace += F[p, i, i]
                square += squared(F[p, i, i] - 1.0)
                for j in range(i):
                    square += 0.5 * squared(F[p, i, j] + F[p, j, i])
            out[p] = 0.5 * lame * squared(trace) + shear * square

    return energy


_STRESS = by_dimension(_make_stress)
_ENERGY = by_dimension(_make_energy)

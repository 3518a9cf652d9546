"""Von Mises (J2) plasticity at small strains with linear isotropic hardening."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gimpmd_gimp.laws.law import TRUSTED, History, LawMakers, by_dimension, kernel, squared
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.materials import J2
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.mechanics.units import UNITS

NORMAL = 3
"""Normal components of the plastic strain. Across the plane or the bar they are not zero either."""

ROOT = (2.0 / 3.0) ** 0.5
"""Ratio of the radius of the yield surface (a norm of the stress deviator) to the yield stress."""


@dataclass(frozen=True)
class J2Plasticity:
    """Isotropic elasticity with a von Mises yield surface that grows with plastic strain.

    With the strain ``eps = sym(F) - I``, the plastic strain ``eps_p`` and the equivalent plastic
    strain ``alpha``,

        tau = lame tr(eps) I + 2 shear (eps - eps_p),
        |dev(tau)| <= sqrt(2/3) (yield_stress + hardening alpha).

    The history variables are updated by radial return (Simo and Hughes, Computational
    Inelasticity, 1998, box 3.1, without kinematic hardening), which is the implicit Euler method
    for the associated flow rule. In two dimensions this is plane strain, in one dimension uniaxial
    strain. The strains across the plane or the bar are zero, but their plastic parts are not.

    The stored energy is the elastic energy and the energy of hardening,

        W = lame / 2 tr(eps)^2 + shear |eps - eps_p|^2 + hardening alpha^2 / 2.

    The rest of the plastic work, ``yield_stress alpha``, is dissipated.

    Attributes
    ----------
    density : float
        Mass per reference volume.
    lame, shear : float
        Lame's lambda and the shear modulus mu (mechanical units).
    yield_stress : float
        Stress at which a bar yields in uniaxial tension (mechanical units).
    hardening : float
        Slope of the yield stress over the equivalent plastic strain; 0 for ideal plasticity.
    dimension : int
        1, 2 or 3.
    """

    density: float
    lame: float
    shear: float
    yield_stress: float
    hardening: float
    dimension: int

    name: ClassVar[str] = "J2 plasticity"
    finite: ClassVar[bool] = False

    @property
    def history(self) -> History:
        """Plastic strain (xx, yy, zz, then engineering shears in Voigt order), and alpha."""
        shears = self.dimension * (self.dimension - 1) // 2
        return ("plastic_strain", NORMAL + shears), ("equivalent_plastic_strain", 1)

    def stress(
        self, order: Ints, first: int, last: int, F: Floats, history: Floats, out: Floats
    ) -> None:
        """Kirchhoff stress; see `Law`."""
        moduli = self.lame, self.shear
        _STRESS[self.dimension](order, first, last, F, history, *moduli, out)

    def energy(
        self, order: Ints, first: int, last: int, F: Floats, history: Floats, out: Floats
    ) -> None:
        """Elastic energy and energy of hardening; see `Law`."""
        moduli = self.lame, self.shear, self.hardening
        _ENERGY[self.dimension](order, first, last, F, history, *moduli, out)

    def update(self, order: Ints, first: int, last: int, F: Floats, history: Floats) -> None:
        """Return the stress to the yield surface; see `InelasticLaw`."""
        moduli = self.shear, self.yield_stress, self.hardening
        _UPDATE[self.dimension](order, first, last, F, history, *moduli)

    def dissipation(self, order: Ints, first: int, last: int, history: Floats, out: Floats) -> None:
        """``yield_stress alpha``; see `InelasticLaw`."""
        chosen = order[first:last]
        out[chosen] = self.yield_stress * history[chosen, -1]

    def wave_speed(self) -> float:
        """Speed of elastic longitudinal waves, ``sqrt((lame + 2 shear) / density)``."""
        return float(((self.lame + 2.0 * self.shear) / self.density) ** 0.5)

    @property
    def trusted_strain(self) -> float:
        """Strain up to which small strains are small; see `Law`."""
        return TRUSTED


def from_material(material: J2, plan: Plan) -> J2Plasticity:
    """Law of a material ``from: j2``."""
    mechanical = UNITS[plan.units].stress_to_mechanical
    return J2Plasticity(
        density=material.density,
        lame=mechanical(material.lame),
        shear=mechanical(material.shear),
        yield_stress=mechanical(material.yield_stress),
        hardening=mechanical(material.hardening),
        dimension=plan.dim,
    )


MATERIALS: LawMakers = {J2: from_material}


@kernel
def _column(d: int, i: int, j: int) -> int:
    """Column of a component of the plastic strain: xx, yy, zz, then the shears in Voigt order."""
    if i == j:
        return i
    return NORMAL if d == 2 else 6 - i - j


@kernel
def _elastic(F: Floats, history: Floats, p: int, d: int, i: int, j: int) -> float:
    """Component of the elastic strain ``eps - eps_p`` of point p."""
    plastic = history[p, _column(d, i, j)]
    if i != j:
        return 0.5 * (F[p, i, j] + F[p, j, i] - plastic)
    return F[p, i, i] - 1.0 - plastic if i < d else -plastic


@kernel
def _trace(F: Floats, p: int, d: int) -> float:
    """Trace of the strain of point p. The plastic strain has none."""
    trace = -float(d)
    for i in range(d):
        trace += F[p, i, i]
    return trace


@kernel
def _square(F: Floats, history: Floats, p: int, d: int, mean: float) -> float:
    """``|eps - eps_p - mean I|^2`` of point p, in three dimensions."""
    square = 0.0
    for i in range(NORMAL):
        square += squared(_elastic(F, history, p, d, i, i) - mean)
        for j in range(i + 1, d):
            square += 2.0 * squared(_elastic(F, history, p, d, i, j))
    return square


def _make_stress(d: int) -> Callable[..., None]:
    @kernel
    def stress(
        order: Ints,
        first: int,
        last: int,
        F: Floats,
        history: Floats,
        lame: float,
        shear: float,
        out: Floats,
    ) -> None:
        for k in range(first, last):
            p = np.uint64(order[k])  # unsigned: no test for indices from the end
            pressure = lame * _trace(F, p, d)
            for i in range(d):
                out[p, i, i] = pressure + 2.0 * shear * _elastic(F, history, p, d, i, i)
                for j in range(i + 1, d):
                    tau = 2.0 * shear * _elastic(F, history, p, d, i, j)
                    out[p, i, j] = tau
                    out[p, j, i] = tau

    return stress


def _make_energy(d: int) -> Callable[..., None]:
    @kernel
    def energy(
        order: Ints,
        first: int,
        last: int,
        F: Floats,
        history: Floats,
        lame: float,
        shear: float,
        hardening: float,
        out: Floats,
    ) -> None:
        alpha = history.shape[1] - 1
        for k in range(first, last):
            p = np.uint64(order[k])
            elastic = 0.5 * lame * squared(_trace(F, p, d)) + shear * _square(F, history, p, d, 0.0)
            out[p] = elastic + 0.5 * hardening * squared(history[p, alpha])

    return energy


def _make_update(d: int) -> Callable[..., None]:
    @kernel
    def update(
        order: Ints,
        first: int,
        last: int,
        F: Floats,
        history: Floats,
        shear: float,
        yield_stress: float,
        hardening: float,
    ) -> None:
        alpha = history.shape[1] - 1
        for k in range(first, last):
            p = np.uint64(order[k])
            mean = _trace(F, p, d) / 3.0
            deviator = np.sqrt(_square(F, history, p, d, mean))
            radius = ROOT * (yield_stress + hardening * history[p, alpha])
            excess = 2.0 * shear * deviator - radius
            if excess <= 0.0:
                continue
            multiplier = excess / (2.0 * shear + 2.0 / 3.0 * hardening)
            share = multiplier / deviator
            for i in range(NORMAL):
                for j in range(i + 1, d):
                    flow = share * _elastic(F, history, p, d, i, j)
                    history[p, _column(d, i, j)] += 2.0 * flow
                flow = share * (_elastic(F, history, p, d, i, i) - mean)
                history[p, i] += flow
            history[p, alpha] += ROOT * multiplier

    return update


_STRESS = by_dimension(_make_stress)
_ENERGY = by_dimension(_make_energy)
_UPDATE = by_dimension(_make_update)

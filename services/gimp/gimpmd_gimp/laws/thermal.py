"""Thermal stress of the continuum, and thermal forces in the bonds of a plane crystal."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.materials import (
    Anisotropic,
    EmbeddedLattice,
    Hyperelastic,
    PairLattice,
)
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.mechanics.elasticity import VOIGT
from gimpmd_schemas.mechanics.units import UNITS

WAVES = (32, 64)
"""Wave vectors along each axis of the reciprocal cell. The mean over wave vectors is extrapolated
from sums with these two numbers."""

UNSTABLE = 1e-9
"""A crystal is unstable if its least stiffness of a vibration, over the largest, is below this."""


def thermal_forces(
    bonds: Floats, coefficients: Sequence[Sequence[float]], area: float, heat: float
) -> Floats:
    """Mean forces in the bonds at rest, caused by the vibrations of the crystal.

    In the classical quasi-harmonic approximation (Born and Huang, Dynamical Theory of Crystal
    Lattices, 1954) vibrations add ``heat / 2 <ln det D(k)>`` to the energy of a primitive cell.
    The mean is taken over wave vectors k. The dynamical matrix, without the mass, is

        D(k) = sum_b 2 (1 - cos k.R_b) K_b,   K_b = d^2 phi_b / dr dr.

    Its exact derivative with respect to the vector r of a bond is
    ``heat / 2 tr(<2 (1 - cos k.R_b) D^-1> dK_b/dr)``. The approximation neglects terms of second
    order in the heat.

    Parameters
    ----------
    bonds : ndarray, shape ``(m, 2)``
        Vectors to the neighbours at rest, as in `LatticeSum`.
    coefficients : sequence of m sequences
        Polynomial of each bond's energy, as in `LatticeSum`.
    area : float
        Area of the primitive cell.
    heat : float
        Boltzmann's constant times the temperature, in the unit of the coefficients.

    Returns
    -------
    ndarray, shape ``(m, 2)``
        Derivatives of the energy with respect to the vectors of the bonds. The force is opposite
        to the vector where the two ends repel each other.

    Raises
    ------
    BackendError
        The crystal is unstable at rest, or no two of the bonds span its primitive cell.
    """
    padded = [[*c, 0.0, 0.0, 0.0][:3] for c in coefficients]
    first, second, third = (np.array(padded) * [1.0, 2.0, 6.0]).T[:, :, None]
    square = (bonds**2).sum(axis=1)[:, None]
    # s = |r|^2 / |R|^2
    outer = bonds[:, :, None] * bonds[:, None, :]
    K = (2.0 * first / square)[:, :, None] * np.eye(2)
    K += (4.0 * second / square**2)[:, :, None] * outer
    reciprocal = np.asarray(2.0 * np.pi * np.linalg.inv(_basis(bonds, area)).T)
    coarse, fine = (_responses(bonds, K, reciprocal, n) for n in WAVES)
    # D^-1 depends on the direction at k = 0, so the mean converges as n^-2
    ratio = (WAVES[1] / WAVES[0]) ** 2
    G = (ratio * fine - coarse) / (ratio - 1.0)
    along = np.einsum("bij,bj->bi", G, bonds)
    size = np.einsum("bii->b", G)[:, None]
    forces = 4.0 * second / square**2 * (size * bonds + 2.0 * along)
    forces += 8.0 * third / square**3 * (along * bonds).sum(axis=1)[:, None] * bonds
    return np.asarray(0.5 * heat * forces)


def thermal_stress(
    bonds: Floats, coefficients: Sequence[Sequence[float]], area: float, heat: float
) -> Floats:
    """Second Piola-Kirchhoff stress at rest of the `thermal_forces`, shape ``(3,)``, Voigt order.

    It is negative (a pressure) where the vibrations expand the crystal. Parameters and errors are
    those of `thermal_forces`.
    """
    t = thermal_forces(bonds, coefficients, area, heat)
    S = np.einsum("bi,bj->ij", t, bonds) / area
    return np.array([S[0, 0], S[1, 1], 0.5 * (S[0, 1] + S[1, 0])])


def stress_of_plan(plan: Plan) -> Floats:
    """Thermal stress of the plan's material (mechanical units), Voigt; zero without a temperature.

    Raises
    ------
    BackendError
        See `thermal_forces`.
    """
    material, T, units = plan.continuum.material, plan.continuum.temperature, UNITS[plan.units]
    heat = plan.thermal_energy()
    if (
        T is not None
        and isinstance(material, Anisotropic | Hyperelastic | EmbeddedLattice)
        and material.thermal_stress
    ):
        return units.stress_to_mechanical(T) * np.array(material.thermal_stress)
    if heat is not None and isinstance(material, PairLattice):
        energy = [[units.energy_to_mechanical(c) for c in bond] for bond in material.energy]
        return thermal_stress(np.array(material.bonds), energy, material.area, heat)
    return np.zeros(len(VOIGT[plan.dim]))


def _basis(bonds: Floats, area: float) -> Floats:
    """Find two bonds that span a primitive cell; one bond per row."""
    for one, other in combinations(bonds, 2):
        if abs(abs(one[0] * other[1] - one[1] * other[0]) - area) < 1e-6 * area:
            return np.array([one, other])
    raise BackendError(
        "continuum.temperature: the vibrations of the crystal are unknown, because no two of its "
        f"bonds span its primitive cell of area {area:g}; give all bonds within the cutoff, or "
        "leave the key out"
    )


def _responses(bonds: Floats, K: Floats, reciprocal: Floats, n: int) -> Floats:
    """Mean of ``2 (1 - cos k.R_b) D^-1`` over n x n wave vectors, none zero; ``(m, 2, 2)``."""
    part = (np.arange(n) + 0.5) / n
    k = np.stack(np.meshgrid(part, part), axis=-1).reshape(-1, 2) @ reciprocal
    swing = 2.0 * (1.0 - np.cos(k @ bonds.T))
    D = np.einsum("kb,bij->kij", swing, K)
    stiffness = np.linalg.eigvalsh(D)
    if stiffness.min() <= UNSTABLE * np.abs(stiffness).max():
        raise BackendError(
            "continuum.temperature: the crystal of continuum.material is unstable at rest, so its "
            "vibrations are unknown; check the lattice constant, or leave the key out"
        )
    return np.asarray(np.einsum("kij,kb->bij", np.linalg.inv(D), swing) / len(k))

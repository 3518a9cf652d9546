"""Thermal forces and stress of a plane crystal bound in pairs, from its lattice's vibrations."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.errors import BackendError

WAVES = (32, 64)
"""Wave vectors along each axis of the cell of the reciprocal lattice, in the two sums from which
the mean is extrapolated."""

UNSTABLE = 1e-9
"""Ratio of a vibration's stiffness and the largest below which it is none."""


def thermal_forces(
    bonds: Floats, coefficients: Sequence[Sequence[float]], area: float, heat: float
) -> Floats:
    """Mean forces in the bonds at rest that the crystal's vibrations make.

    In the classical quasi-harmonic approximation (Born and Huang, Dynamical Theory of Crystal
    Lattices, 1954) vibrations add ``heat / 2 <ln det D(k)>`` to the energy of a primitive cell, the
    mean taken over wave vectors, with the dynamical matrix (less the mass)

        D(k) = sum_b 2 (1 - cos k.R_b) K_b,   K_b = d^2 phi_b / dr dr.

    Its derivative by the vector r of a bond, ``heat / 2 tr(<2 (1 - cos k.R_b) D^-1> dK_b/dr)``, is
    exact. What is left out is of second order in the heat.

    Parameters
    ----------
    bonds : ndarray, shape ``(m, 2)``
        As `LatticeSum` has them, likewise the coefficients and the area of the primitive cell.
    heat : float
        Boltzmann's constant times the temperature, in the coefficients' unit.

    Returns
    -------
    ndarray, shape ``(m, 2)``
        As derivatives of an energy: against the bond's vector where the ends push each other.

    Raises
    ------
    BackendError
        The crystal does not hold together at rest, or the bonds do not tell its lattice.
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
    # the mean has a kink at k = 0, where D^-1 depends on the direction: an error as n^-2
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
    """Second Piola-Kirchhoff stress at rest of the `thermal_forces`, shape ``(3,)``, Voigt.

    Negative where the crystal pushes; parameters and errors are those of the forces.
    """
    t = thermal_forces(bonds, coefficients, area, heat)
    S = np.einsum("bi,bj->ij", t, bonds) / area
    return np.array([S[0, 0], S[1, 1], 0.5 * (S[0, 1] + S[1, 0])])


def _basis(bonds: Floats, area: float) -> Floats:
    """Two bonds that span a primitive cell, one a row."""
    for one, other in combinations(bonds, 2):
        if abs(abs(one[0] * other[1] - one[1] * other[0]) - area) < 1e-6 * area:
            return np.array([one, other])
    raise BackendError(
        f"continuum.temperature: no two of the crystal's bonds span its primitive cell of area "
        f"{area:g}, so its vibrations are not known; give all bonds within the cutoff, or leave "
        "the key out"
    )


def _responses(bonds: Floats, K: Floats, reciprocal: Floats, n: int) -> Floats:
    """``<2 (1 - cos k.R_b) D^-1>`` over n x n wave vectors, none of them zero, ``(m, 2, 2)``."""
    part = (np.arange(n) + 0.5) / n
    k = np.stack(np.meshgrid(part, part), axis=-1).reshape(-1, 2) @ reciprocal
    swing = 2.0 * (1.0 - np.cos(k @ bonds.T))
    D = np.einsum("kb,bij->kij", swing, K)
    stiffness = np.linalg.eigvalsh(D)
    if stiffness.min() <= UNSTABLE * np.abs(stiffness).max():
        raise BackendError(
            "continuum.temperature: the crystal of continuum.material does not hold together at "
            "rest, so it has no vibrations; check the lattice constant, or leave the key out"
        )
    return np.asarray(np.einsum("kij,kb->bij", np.linalg.inv(D), swing) / len(k))

"""Thermal stress of a plane crystal bound in pairs, from the vibrations of its lattice."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid import Floats

WAVES = (32, 64)
"""Wave vectors along each axis of the cell of the reciprocal lattice, in the two sums from which
the mean is extrapolated."""

STRAINS = np.array([[[1.0, 0.0], [0.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]], [[0.0, 0.5], [0.5, 0.0]]])
"""Unit strains in Voigt's order, with engineering shear."""

UNSTABLE = 1e-9
"""Ratio of a vibration's stiffness and the largest below which it is none."""


def thermal_stress(
    bonds: Floats, coefficients: Sequence[Sequence[float]], area: float, heat: float
) -> Floats:
    """Second Piola-Kirchhoff stress at rest that the crystal's vibrations make.

    In the classical quasi-harmonic approximation (Born and Huang, Dynamical Theory of Crystal
    Lattices, 1954) vibrations add ``heat / (2 A) <ln det D(k)>`` to the energy per area, the mean
    taken over wave vectors, with the dynamical matrix (less the mass)

        D(k) = sum_b 2 (1 - cos k.R_b) K_b,   K_b = d^2 phi_b / dr dr.

    Its derivative by the strain, ``heat / (2 A) <tr D^-1 dD/dE>``, is exact; K_b changes with the
    length of the bond and with its direction. What is left out is of second order in the heat.

    Parameters
    ----------
    bonds : ndarray, shape ``(m, 2)``
        As `LatticeSum` has them, likewise the coefficients and the area of the primitive cell.
    heat : float
        Boltzmann's constant times the temperature, in the coefficients' unit.

    Returns
    -------
    ndarray, shape ``(3,)``
        In Voigt's order; negative where the crystal pushes.

    Raises
    ------
    BackendError
        The crystal does not hold together at rest, or the bonds do not tell its lattice.
    """
    K, dK = _stiffnesses(bonds, coefficients)
    reciprocal = np.asarray(2.0 * np.pi * np.linalg.inv(_basis(bonds, area)).T)
    coarse, fine = (_mean(bonds, K, dK, reciprocal, n) for n in WAVES)
    # the mean has a kink at k = 0, where the slope depends on the direction: an error as n^-2
    ratio = (WAVES[1] / WAVES[0]) ** 2
    return np.asarray(0.5 * heat / area * (ratio * fine - coarse) / (ratio - 1.0))


def _stiffnesses(bonds: Floats, coefficients: Sequence[Sequence[float]]) -> tuple[Floats, Floats]:
    """K of every bond at rest, ``(m, 2, 2)``, and its derivatives by the strains, ``(3, m, 2, 2)``.

    With ``s = |r|^2 / |R|^2``: ``K = 2 phi' / |R|^2 I + 4 phi'' / |R|^4 r r^T``, r = (I + E) R.
    """
    padded = [[*c, 0.0, 0.0, 0.0][:3] for c in coefficients]
    first, second, third = (np.array(padded) * [1.0, 2.0, 6.0]).T[:, :, None, None]
    square = (bonds**2).sum(axis=1)[:, None, None]
    unit, outer = np.eye(2), bonds[:, :, None] * bonds[:, None, :]
    K = 2.0 * first / square * unit + 4.0 * second / square**2 * outer
    ds = 2.0 * np.einsum("bi,vij,bj->vb", bonds, STRAINS, bonds)[:, :, None, None] / square
    turned = np.einsum("vij,bj,bk->vbik", STRAINS, bonds, bonds)
    dK = ds * (2.0 * second / square * unit + 4.0 * third / square**2 * outer)
    dK += 4.0 * second / square**2 * (turned + turned.swapaxes(2, 3))
    return K, dK


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


def _mean(bonds: Floats, K: Floats, dK: Floats, reciprocal: Floats, n: int) -> Floats:
    """``<tr D^-1 dD/dE>`` over n x n wave vectors, none of them zero, shape ``(3,)``."""
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
    weight = np.einsum("kij,kb->bij", np.linalg.inv(D), swing) / len(k)
    return np.einsum("bij,vbji->v", weight, dK)

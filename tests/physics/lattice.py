"""Lattice sums of the two-dimensional hexagonal Lennard-Jones crystal, in reduced units."""

from __future__ import annotations

import numpy as np

SPACING = 1.1132013035564605
"""Of no stress, for the cutoff."""

CUTOFF = 2.5
AREA = SPACING**2 * 3**0.5 / 2
DENSITY = 1.0 / AREA

_i, _j = np.meshgrid(np.arange(-5, 6), np.arange(-5, 6))
_all = SPACING * np.stack([_i + 0.5 * _j, 3**0.5 / 2 * _j], axis=-1).reshape(-1, 2)
NEIGHBOURS = _all[np.linalg.norm(_all, axis=1) > 0.1]
"""Positions about an atom, close-packed along x; far more than the cutoff sees."""


def bonds() -> tuple[np.ndarray, list[list[float]]]:
    """Half of the bonds, and ``c_1, c_2, c_3`` of the energy of each over ``|r|^2 / |R|^2 - 1``."""
    R = NEIGHBOURS[np.linalg.norm(NEIGHBOURS, axis=1) < CUTOFF]
    R = R[(R[:, 1] > 1e-9) | ((np.abs(R[:, 1]) < 1e-9) & (R[:, 0] > 0.0))]
    r6 = (R**2).sum(axis=1) ** -3  # phi = 4 (r6^2 s^-6 - r6 s^-3)
    energy = [
        [4.0 * r6 * (-6.0 * r6 + 3.0), 4.0 * r6 * (21.0 * r6 - 6.0), 4.0 * r6 * (-56.0 * r6 + 10.0)]
        for r6 in r6
    ]
    return R, energy


def deform(F: np.ndarray, turn: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Energy per reference area, relative to rest, and Kirchhoff stress at ``F (n, 2, 2)``.

    ``turn`` is the angle of the close-packed rows to the x axis.
    """
    c, s = np.cos(turn), np.sin(turn)
    bonds = NEIGHBOURS @ np.array([[c, s], [-s, c]])

    def sums(F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r = np.einsum("nij,bj->nbi", F, bonds)
        square = (r**2).sum(axis=2)
        seen = square < CUTOFF**2
        energy = np.where(seen, 4.0 * (square**-6 - square**-3), 0.0)
        slope = np.where(seen, 4.0 * (3.0 * square**-4 - 6.0 * square**-7), 0.0)  # by r^2
        tau = np.einsum("nb,nbi,nbj->nij", slope, r, r) / AREA
        return energy.sum(axis=1) / (2.0 * AREA), tau

    rest = np.eye(2)[None]
    W, tau = sums(F)
    return W - sums(rest)[0], tau


def strains(E: np.ndarray, turn: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Energy and second Piola-Kirchhoff stress at Green-Lagrange strains ``(n, 3)``, Voigt."""
    C = np.eye(2) + 2.0 * E[:, [[0, 2], [2, 1]]] * [[1.0, 0.5], [0.5, 1.0]]
    F = np.linalg.cholesky(C).transpose(0, 2, 1)
    W, tau = deform(F, turn)
    back = np.linalg.inv(F)
    S = back @ tau @ back.transpose(0, 2, 1)
    return W, np.stack([S[:, 0, 0], S[:, 1, 1], S[:, 0, 1]], axis=1)

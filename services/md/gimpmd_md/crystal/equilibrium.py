"""The state of a cell at zero pressure and temperature, and its elastic constants there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from gimpmd_md.crystal.cell import Cell
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.mechanics.elasticity import VOIGT

FACTORS = tuple(np.linspace(0.85, 1.15, 31).tolist())
"""Factors of the edges of a user's cell among which the state of least energy is searched."""

STRAIN = 1e-4
"""Strain of the central differences; their error is its square times the third-order moduli."""

ITERATIONS = 10
"""Most steps of Newton's method; four are enough where the energy is smooth."""

AT_REST, ACCEPTED = 1e-9, 1e-6
"""Stress over C11 at which the cell counts as at rest, and largest stress that is accepted when
Newton's method gets no further: forces of tables are not smooth."""


def near_rest(cell: Cell, factors: Sequence[float]) -> float:
    """Find the factor of all edges at which the energy of the cell is least.

    The atoms keep their relative places.

    Parameters
    ----------
    factors : sequence of float
        Factors that bracket the minimum, ascending.

    Raises
    ------
    BackendError
        The energy has no minimum between the first and the last factor.
    """
    rigid, one = replace(cell, tolerance=None), np.eye(len(cell.box))

    def energy(factor: float) -> float:
        return rigid.deform(factor * one)[0]

    E = np.array([energy(factor) for factor in factors])
    lower = (E[1:-1] <= E[:-2]) & (E[1:-1] <= E[2:]) & (E[1:-1] < E[-1])
    inside = np.flatnonzero(lower) + 1
    if not inside.size:
        raise BackendError(
            f"{cell.script}: no crystal at zero pressure: the energy has no minimum between "
            f"{factors[0]:.3g} and {factors[-1]:.3g} times the edges of the cell"
        )
    lowest = inside[np.argmin(E[inside])]
    found = minimize_scalar(
        energy, bounds=(factors[lowest - 1], factors[lowest + 1]), method="bounded"
    )
    return float(found.x)


def at_rest(cell: Cell, start: Floats) -> tuple[Floats, Floats]:
    """Find the deformation without stress, by Newton's method from a start near it.

    Parameters
    ----------
    start : ndarray, shape ``(d, d)``
        Deformation gradient of the cell, upper triangular.

    Returns
    -------
    F : ndarray, shape ``(d, d)``
        Deformation gradient, upper triangular.
    stiffness : ndarray, shape ``(n, n)``
        Elastic constants there (pressure units), in Voigt order.

    Raises
    ------
    BackendError
        The crystal is not stable, or its stress does not vanish.
    """
    F = start
    for _ in range(ITERATIONS):
        sigma, C = _stress(cell, F), stiffness(cell, F)
        _check_stability(cell, C)
        size = float(np.abs(sigma).max() / C[0, 0])
        if size < AT_REST:
            break
        e = np.asarray(np.linalg.solve(C, sigma), float)
        F = (np.eye(len(F)) - _strain(e, len(F))) @ F
    if size > ACCEPTED:
        raise BackendError(f"{cell.script}: LAMMPS finds no state without stress near this cell")
    return F, C


def _check_stability(cell: Cell, C: Floats) -> None:
    values = np.linalg.eigvalsh(C)
    if not values.min() > 0.0:
        numbers = ", ".join(f"{value:.4g}" for value in values)
        raise BackendError(
            f"{cell.script}: the crystal is not stable: the eigenvalues of its stiffness are "
            f"{numbers}; choose another crystal structure or potential"
        )


def stiffness(cell: Cell, F: Floats) -> Floats:
    """Change of stress with strain at a deformation (pressure units), shape ``(n, n)``."""
    n = len(VOIGT[len(F)])
    C = np.empty((n, n))
    for column, e in enumerate(STRAIN * np.eye(n)):
        up, down = (_stress(cell, (np.eye(len(F)) + s * _strain(e, len(F))) @ F) for s in (1, -1))
        C[:, column] = (up - down) / (2.0 * STRAIN)
    return 0.5 * (C + C.T)


def _strain(e: Floats, dim: int) -> Floats:
    """Displacement gradient of a strain in Voigt order, upper triangular, shape ``(d, d)``."""
    gradient = np.zeros((dim, dim))
    for value, (i, j) in zip(e, VOIGT[dim], strict=True):
        gradient[i, j] = value
    return gradient


def _stress(cell: Cell, F: Floats) -> Floats:
    """Cauchy stress in Voigt order (pressure units)."""
    _, tau = cell.deform(F)
    sigma = tau / np.linalg.det(F)
    return np.array([sigma[i, j] for i, j in VOIGT[len(F)]])

"""The strain energy of the user's crystal at finite strains: a fit to results of LAMMPS.

Under slowly varying strain the atoms of a crystal follow the deformation (Cauchy-Born rule), so the
energy per area is that of a periodic cell. LAMMPS gives energy and stress of the cell at many
Green-Lagrange strains E. `gimpmd_schemas.mechanics.hyperelastic` defines the polynomial W(E).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from gimpmd_md.crystal.cell import Cell
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.mechanics.hyperelastic import degree_of, exponents

STRAIN_LIMITS = (0.06, 0.05, 0.04, 0.03, 0.02)
"""Norms of the strain up to which polynomials are tried; the first that is accurate is taken."""

DEGREES = range(3, 9)
"""Degrees of the polynomials, in the order in which they are tried."""

TOLERANCES = ((0.01, 1e-3), (0.04, 5e-3), (STRAIN_LIMITS[0], 1e-2))
"""Norms of the strain, and the accepted relative error of the stress at each."""

LEAST_CURVATURE = 0.1
"""Smallest curvature of the energy along every ray at the limit, divided by that at rest. Beyond
the limit the energy continues with this curvature, and it must grow."""

NEGLIGIBLE = 1e-6
"""Terms smaller than this, relative to the largest one, are zero by symmetry."""

DIRECTIONS = 40
"""Directions of the strain in the table, without their mirror images."""

SHARES = np.array([1.0, 1.0, 0.5])
"""``E : E = sum_v SHARES[v] E[v]^2``; the engineering shear is twice a component."""


class Table(NamedTuple):
    """Strains (n, 3) in Voigt order; energies (n,) and slopes dW/dE (n, 3) above those at rest."""

    E: Floats
    W: Floats
    S: Floats


class Fit(NamedTuple):
    """Coefficients of the polynomial (pressure units), and the largest norm of strain."""

    coefficients: Floats
    strain_limit: float


def strain_energy(cell: Cell) -> Fit:
    """Tabulate the energy of a cell, and fit a polynomial.

    The stress of the cell at rest is subtracted; `moduli.measure` checks that it is small.

    Raises
    ------
    BackendError
        The energy is not smooth, or the crystal softens, even at small strains.
    """
    for limit in STRAIN_LIMITS:
        norms = [min(norm, limit) for norm, _ in TOLERANCES]
        table = tabulate(cell, shells(_radii(limit), seed=1))
        checks = [tabulate(cell, shells([norm], seed=2)) for norm in norms]
        for degree in DEGREES:
            coefficients = fit(table, degree)
            accurate = all(
                stress_error(coefficients, check) <= most
                for check, (_, most) in zip(checks, TOLERANCES, strict=True)
            )
            if accurate and least_curvature(coefficients, limit) >= LEAST_CURVATURE:
                return Fit(coefficients, limit)
    raise BackendError(
        f"{cell.script}: no polynomial of degree {DEGREES[-1]} describes the crystal's energy up "
        f"to strains of {STRAIN_LIMITS[-1]:g}: it is not smooth (neighbours may cross the "
        "cutoff, or atoms jump) or the crystal softens; use model: linear"
    )


def tabulate(cell: Cell, E: Floats) -> Table:
    """Energy and stress in LAMMPS at Green-Lagrange strains, shape ``(n, 3)``.

    The deformation gradient is the upper triangular F of ``F^T F = I + 2 E``.
    """
    W, S = np.empty(len(E)), np.empty_like(E)
    rest, stress = cell.deform(np.eye(2))
    for n, (xx, yy, xy) in enumerate(E):
        F = np.linalg.cholesky([[1.0 + 2.0 * xx, xy], [xy, 1.0 + 2.0 * yy]]).T
        W[n], tau = cell.deform(F)
        back = np.linalg.inv(F)
        S[n] = _voigt(back @ tau @ back.T - stress)
    return Table(E, W - rest - E @ _voigt(stress), S)


def _voigt(stress: Floats) -> Floats:
    return np.array([stress[0, 0], stress[1, 1], stress[0, 1]])


def shells(norms: Iterable[float], seed: int) -> Floats:
    """Strains of given norms in random directions, with their mirror images."""
    rays = np.random.default_rng(seed).standard_normal((DIRECTIONS, 3))
    rays /= np.sqrt(rays**2 @ SHARES)[:, None]
    rays = np.concatenate(
        [rays, rays * (1.0, 1.0, -1.0)]
    )  # terms that are zero by symmetry come out as zero
    return np.concatenate([norm * rays for norm in norms])


def _radii(limit: float) -> Floats:
    """Chebyshev points between 0 and the limit, denser at the limit."""
    count = DEGREES[-1] + 2
    return limit * np.cos(np.pi * (2 * np.arange(count) + 1) / (4 * count))


def fit(table: Table, degree: int) -> Floats:
    """Coefficients, in the order of ``exponents``, by least squares of energies and stresses.

    Errors are relative, so that small strains count as much as large ones: errors of energies are
    divided by the squared strain, errors of stresses by the strain. Terms that are zero by symmetry
    are set to zero.
    """
    powers = exponents(3, degree)
    value, slope = terms(table.E, powers)
    norm = np.sqrt(table.E**2 @ SHARES)
    weight = SHARES**-0.5 / norm[:, None]  # a shear stress is in the tensor twice
    rows = np.concatenate(
        [value / norm[:, None] ** 2, (slope * weight[:, :, None]).reshape(-1, len(powers))]
    )
    values = np.concatenate([table.W / norm**2, (table.S * weight).ravel()])

    size = norm.max() ** powers.sum(axis=1)  # of a term at the largest strain
    kept, coefficients = np.ones(len(powers), dtype=bool), np.zeros(len(powers))
    for _ in range(2):
        solved = np.linalg.lstsq(rows[:, kept] / size[kept], values, rcond=None)[0]
        coefficients[:] = 0.0
        coefficients[kept] = solved / size[kept]
        kept = np.abs(coefficients) * size > NEGLIGIBLE * np.abs(solved).max()
    return coefficients


def terms(E: Floats, powers: Ints) -> tuple[Floats, Floats]:
    """Value ``(n, terms)`` and slope ``(n, 3, terms)`` of every term at strains ``(n, 3)``."""
    value = np.prod(E[:, None] ** powers, axis=2)
    slope = np.empty((len(E), 3, len(powers)))
    for v in range(3):
        lower = powers.copy()
        lower[:, v] = np.maximum(lower[:, v] - 1, 0)
        slope[:, v] = powers[:, v] * np.prod(E[:, None] ** lower, axis=2)
    return value, slope


def stress_error(coefficients: Floats, table: Table) -> float:
    """Largest error of the stress ``dW/dE`` in a table, relative to the stress there."""
    _, slope = terms(table.E, _powers(coefficients))
    missing = slope @ coefficients - table.S
    return float(np.sqrt(((missing**2 / SHARES).sum(1) / (table.S**2 / SHARES).sum(1)).max()))


def least_curvature(coefficients: Floats, norm: float) -> float:
    """Smallest curvature of the energy along a ray at a given strain, divided by that at rest."""
    powers = _powers(coefficients)
    value, _ = terms(shells([norm], seed=3), powers)
    k = powers.sum(axis=1)
    curvature = value * (k * (k - 1) * coefficients)
    return float((curvature.sum(axis=1) / curvature[:, k == 2].sum(axis=1)).min())


def _powers(coefficients: Floats) -> Ints:
    degree = degree_of(3, coefficients.size)
    if degree is None:
        raise ValueError(f"no polynomial in 3 strains has {coefficients.size} coefficients")
    return exponents(3, degree)

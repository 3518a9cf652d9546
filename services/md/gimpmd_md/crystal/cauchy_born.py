"""The strain energy of the user's crystal at finite strains: a fit to results of LAMMPS.

Under slowly varying strain the atoms of a crystal follow the deformation (Cauchy-Born rule), so the
energy per area or volume is that of a periodic cell. LAMMPS gives energy and stress of the cell at
many Green-Lagrange strains E. `gimpmd_schemas.mechanics.hyperelastic` defines the polynomial W(E).
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import permutations, product
from typing import NamedTuple

import numpy as np

from gimpmd_md.crystal.cell import Cell
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.mechanics.elasticity import VOIGT
from gimpmd_schemas.mechanics.hyperelastic import LOWEST, degree_of, exponents, quadratic

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

LIMITS_IN_SPACE = (0.03, 0.02, 0.01)
"""Like `STRAIN_LIMITS`, in three dimensions, where the case gives the degree. A larger range would
cost accuracy at small strains."""

RADII_IN_SPACE = (1 / 6, 1 / 3, 2 / 3, 1.0)
"""Norms of the strains in the table, over the limit, in three dimensions."""

LARGEST_ERROR = 0.1
"""Largest accepted error of the stress at the limit, over the largest stress there, in three
dimensions: about half the error of a quadratic energy."""

DIRECTIONS = 40
"""Directions of the strain in the table, without their mirror images."""

MIRRORS = {
    2: np.array([[1.0, 1.0, 1.0], [1.0, 1.0, -1.0]]),
    3: np.array([[1.0, 1.0, 1.0, a, b, a * b] for a, b in product((1.0, -1.0), repeat=2)]),
}
"""Signs of the components of a strain that is mirrored at planes normal to the axes."""

EXCHANGED = np.array([[*axes, *(3 + a for a in axes)] for axes in permutations(range(3))])
"""Components of a strain in space whose axes are exchanged."""


class Table(NamedTuple):
    """Strains (n, c) in Voigt order; energies (n,) and slopes dW/dE (n, c) above those at rest."""

    E: Floats
    W: Floats
    S: Floats


class Fit(NamedTuple):
    """Coefficients of the polynomial (pressure units), and the largest norm of strain."""

    coefficients: Floats
    strain_limit: float


def shares(components: int) -> Floats:
    """Factors of ``E : E = sum_v shares[v] E[v]^2``; engineering shears are twice a component."""
    dim = {3: 2, 6: 3}[components]
    return np.where(np.arange(components) < dim, 1.0, 0.5)


def strain_energy(cell: Cell) -> Fit:
    """Tabulate the energy of a cell in the plane, and fit a polynomial.

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


def energy_in_space(
    cell: Cell, stiffness: Floats, degree: int, strain_limit: float | None = None
) -> Fit:
    """Tabulate the energy of a cell in space, and fit a polynomial with a given stiffness at rest.

    Parameters
    ----------
    strain_limit : float, optional
        None: the first of `LIMITS_IN_SPACE` at which the polynomial is accurate.

    Raises
    ------
    BackendError
        As in `strain_energy`.
    """
    limits = LIMITS_IN_SPACE if strain_limit is None else (strain_limit,)
    for limit in limits:
        coefficients = fit(tabulate(cell, strains_in_space(limit, degree)), degree, stiffness)
        check = tabulate(cell, shells([limit], seed=2, count=DIRECTIONS // 4, dim=3))
        accurate = largest_error(coefficients, check) <= LARGEST_ERROR
        if accurate and least_curvature(coefficients, limit, 3) >= LEAST_CURVATURE:
            return Fit(coefficients, limit)
    way_out = "use model: linear" if strain_limit is None else "lower strain_limit"
    raise BackendError(
        f"{cell.script}: no polynomial of degree {degree} describes the crystal's energy up to "
        f"strains of {limits[-1]:g}: it is not smooth (neighbours may cross the cutoff, or atoms "
        f"jump) or the crystal softens; {way_out}"
    )


def tabulate(cell: Cell, E: Floats) -> Table:
    """Energy and stress in LAMMPS at Green-Lagrange strains, shape ``(n, c)``.

    The deformation gradient is the upper triangular F of ``F^T F = I + 2 E``.
    """
    dim = len(cell.box)
    W, S = np.empty(len(E)), np.empty_like(E)
    rest, stress = cell.deform(np.eye(dim))
    for n, strain in enumerate(E):
        C = np.eye(dim)
        for value, (i, j) in zip(strain, VOIGT[dim], strict=True):
            C[i, j] = C[j, i] = 1.0 + 2.0 * value if i == j else value
        F = np.asarray(np.linalg.cholesky(C).T, float)
        W[n], tau = cell.deform(F)
        back = np.linalg.inv(F)
        S[n] = _voigt(back @ tau @ back.T - stress)
    return Table(E, W - rest - E @ _voigt(stress), S)


def _voigt(stress: Floats) -> Floats:
    return np.array([stress[i, j] for i, j in VOIGT[len(stress)]])


def shells(norms: Iterable[float], seed: int, count: int = DIRECTIONS, dim: int = 2) -> Floats:
    """Strains of given norms in random directions, with their mirror images.

    Terms that are zero by symmetry then come out as zero.
    """
    weights = shares(len(VOIGT[dim]))
    rays = np.random.default_rng(seed).standard_normal((count, len(weights)))
    rays /= np.sqrt(rays**2 @ weights)[:, None]
    rays = np.concatenate([rays * signs for signs in MIRRORS[dim]])
    return np.concatenate([norm * rays for norm in norms])


def strains_in_space(limit: float, degree: int) -> Floats:
    """Strains of the table in three dimensions, ``(n, 6)``: more directions for a higher degree.

    With exchanged axes, so that terms that are equal by symmetry come out as equal.
    """
    count = 4 + len(exponents(6, degree)) // 50
    norms = [share * limit for share in RADII_IN_SPACE]
    E = shells(norms, seed=1, count=count, dim=3)
    return np.concatenate([E[:, axes] for axes in EXCHANGED])


def _radii(limit: float) -> Floats:
    """Chebyshev points between 0 and the limit, denser at the limit."""
    count = DEGREES[-1] + 2
    return limit * np.cos(np.pi * (2 * np.arange(count) + 1) / (4 * count))


def fit(table: Table, degree: int, stiffness: Floats | None = None) -> Floats:
    """Coefficients, in the order of ``exponents``, by least squares of energies and stresses.

    Errors are relative, so that small strains count as much as large ones: errors of energies are
    divided by the squared strain, errors of stresses by the strain. Terms that are zero by symmetry
    are set to zero.

    Parameters
    ----------
    stiffness : ndarray, shape ``(c, c)``, optional
        Where it is given, only the terms above the quadratic ones are fitted.
    """
    components = table.E.shape[1]
    powers, weights = exponents(components, degree), shares(components)
    value, slope = terms(table.E, powers)
    norm = np.sqrt(table.E**2 @ weights)
    weight = weights**-0.5 / norm[:, None]  # a shear stress is in the tensor twice
    rows = np.concatenate(
        [value / norm[:, None] ** 2, (slope * weight[:, :, None]).reshape(-1, len(powers))]
    )
    values = np.concatenate([table.W / norm**2, (table.S * weight).ravel()])

    size = norm.max() ** powers.sum(axis=1)  # of a term at the largest strain
    known = np.empty(0) if stiffness is None else quadratic(stiffness)
    first = len(known)
    values -= rows[:, :first] @ known
    largest = np.abs(known * size[:first]).max(initial=0.0)
    kept, coefficients = np.arange(len(powers)) >= first, np.zeros(len(powers))
    for _ in range(2):
        solved = np.linalg.lstsq(rows[:, kept] / size[kept], values, rcond=None)[0]
        coefficients[:] = 0.0
        coefficients[kept] = solved / size[kept]
        largest = max(largest, np.abs(solved).max())
        kept = np.abs(coefficients) * size > NEGLIGIBLE * largest
    coefficients[:first] = known
    return coefficients


def terms(E: Floats, powers: Ints) -> tuple[Floats, Floats]:
    """Value ``(n, terms)`` and slope ``(n, c, terms)`` of every term at strains ``(n, c)``."""
    value = _products(E, powers)
    slope = np.empty((*E.shape, len(powers)))
    for v in range(E.shape[1]):
        lower = powers.copy()
        lower[:, v] = np.maximum(lower[:, v] - 1, 0)
        slope[:, v] = powers[:, v] * _products(E, lower)
    return value, slope


def _products(E: Floats, powers: Ints) -> Floats:
    return np.asarray(np.prod(E[:, None] ** powers, axis=2))


def stress_error(coefficients: Floats, table: Table) -> float:
    """Largest error of the stress ``dW/dE`` in a table, relative to the stress there."""
    return float((_missing(coefficients, table) / _sizes(table.S)).max())


def largest_error(coefficients: Floats, table: Table) -> float:
    """Largest error of the stress in a table, over the largest stress there."""
    return float(_missing(coefficients, table).max() / _sizes(table.S).max())


def _missing(coefficients: Floats, table: Table) -> Floats:
    """Norms of the errors of the stress, shape ``(n,)``."""
    _, slope = terms(table.E, _powers(coefficients, table.E.shape[1]))
    return _sizes(slope @ coefficients - table.S)


def _sizes(stress: Floats) -> Floats:
    """Norms of stresses ``(n, c)`` in Voigt order."""
    return np.sqrt((stress**2 / shares(stress.shape[1])).sum(axis=1))


def least_curvature(coefficients: Floats, norm: float, dim: int = 2) -> float:
    """Smallest curvature of the energy along a ray at a given strain, divided by that at rest."""
    rays = shells([norm], seed=3, dim=dim)
    powers = _powers(coefficients, rays.shape[1])
    value, _ = terms(rays, powers)
    k = powers.sum(axis=1)
    curvature = value * (k * (k - 1) * coefficients)
    return float((curvature.sum(axis=1) / curvature[:, k == LOWEST].sum(axis=1)).min())


def _powers(coefficients: Floats, components: int) -> Ints:
    degree = degree_of(components, coefficients.size)
    if degree is None:
        raise ValueError(
            f"no polynomial in {components} strains has {coefficients.size} coefficients"
        )
    return exponents(components, degree)

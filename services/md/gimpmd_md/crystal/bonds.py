"""Energy of the bonds of a crystal: polynomials fitted to the pair potential in LAMMPS."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from gimpmd_md.crystal.bravais import ON_SITE, Lattice, area, half_star, primitive
from gimpmd_md.crystal.cauchy_born import LEAST_CURVATURE, shells
from gimpmd_md.crystal.cell import SAMPLE, Cell
from gimpmd_md.engines.lammps.library import Engine
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.mechanics.units import UNITS

STRETCH_LIMITS = (0.12, 0.1, 0.08, 0.06, 0.04)
"""Values of ``|s - 1|`` up to which polynomials are tried; s is the squared stretch of a bond."""

DEGREES = range(2, 21)
"""Degrees of the polynomials, in the order in which they are tried."""

TOLERANCES = (1e-12, 1e-11, 1e-10, 1e-9, 1e-8, 1e-7, 1e-6)
"""Accepted errors of a bond's force, over its largest force within the limit. The first that a
polynomial fulfils is taken. Analytical potentials fulfil the first one. Tabulated potentials are
piecewise and fulfil one that depends on the distance of their points."""

POINTS = 401
"""Number of distances at which LAMMPS gives the force, evenly spaced in s; s = 1 is one of them. It
is large enough for stable least squares up to degrees of about twice its square root."""

AGREEMENT = 1e-6
"""Relative difference between the stress of the bonds and that of LAMMPS that is round-off."""

Table = Callable[[float, float], Floats]


class Bonds(NamedTuple):
    """Half of the bonds of an atom; see `gimpmd_schemas.case.form.Crystal`.

    Attributes
    ----------
    vectors : ndarray, shape ``(m, 2)``
        One of each opposite pair (length).
    energy : list of ndarray
        Coefficients ``c_1, c_2, ...`` of each bond.
    stretch_limit : float
        Largest ``|s - 1|`` for which they hold.
    """

    vectors: Floats
    energy: list[Floats]
    stretch_limit: float


def stretch_limits(vectors: Floats, cutoff: float) -> list[float]:
    """Limits of ``|s - 1|`` at which no pair of the lattice crosses the cutoff, largest first."""
    R = np.hypot(*half_star(vectors, 2.0 * cutoff).T)
    crossing = np.abs((cutoff / R) ** 2 - 1.0)  # of each pair
    return [limit for limit in STRETCH_LIMITS if (crossing > limit).all()]


def bonds(
    table: Table, vectors: Floats, cutoff: float, limit: float, tolerance: float
) -> Bonds | None:
    """Bonds of a lattice; None if no polynomial is accurate enough up to the limit.

    Parameters
    ----------
    table : callable
        Gives distances, energies and forces of a pair between two distances.
    vectors : ndarray, shape ``(2, 2)``
        Reduced basis of the lattice.
    """
    R = half_star(vectors, cutoff)
    length = np.hypot(*R.T)
    shells: list[tuple[float, Floats]] = []
    energy = []
    for size in length:  # ascending, so bonds of the same length follow each other
        if not shells or size > shells[-1][0] * (1.0 + 1e-9):
            coefficients = polynomial(table, float(size), limit, tolerance)
            if coefficients is None:
                return None
            shells.append((float(size), coefficients))
        energy.append(shells[-1][1])
    return Bonds(R, energy, limit)


def polynomial(table: Table, length: float, limit: float, tolerance: float) -> Floats | None:
    """Coefficients ``c_1, c_2, ...`` of the energy of a bond above that at rest, in ``s - 1``.

    The first one is exactly LAMMPS's force at rest; the others are fitted to its forces.
    """
    low, high = length * (1.0 - limit) ** 0.5, length * (1.0 + limit) ** 0.5
    r, _, force = table(low, high).T
    s = (r / length) ** 2
    slope = -0.5 * force * length**2 / r  # derivative of the energy with respect to s
    size = float(np.abs(slope).max())
    if size == 0.0:
        return np.zeros(2)
    rest = POINTS // 2
    for degree in DEGREES:
        fitted = Chebyshev.fit(s - 1.0, slope, degree - 1, domain=[-limit, limit])
        plain = fitted.convert(kind=Polynomial, domain=[-1, 1], window=[-1, 1]).coef
        coefficients = np.zeros(degree)
        coefficients[: plain.size] = plain
        coefficients[0] = slope[rest]
        missing = Polynomial(coefficients)(s - 1.0) - slope
        if np.abs(missing).max() <= tolerance * size:
            return coefficients / np.arange(1.0, degree + 1.0)
    return None


def candidates(engine: Engine, kind: int, vectors: Floats, cutoff: float) -> Iterator[Bonds]:
    """Bonds in the order of their accuracy, and for the same accuracy the largest limit first."""

    @cache  # all tolerances use the same distances
    def table(low: float, high: float) -> Floats:
        return engine.pair_table(kind, kind, low, high, POINTS)

    for tolerance, limit in product(TOLERANCES, stretch_limits(vectors, cutoff)):
        found = bonds(table, vectors, cutoff, limit, tolerance)
        if found is not None:
            yield found


def best(engine: Engine, kind: int, vectors: Floats, cutoff: float) -> Bonds:
    """The most accurate bonds, and among them those with the largest limit.

    Raises
    ------
    BackendError
        Neighbours cross the cutoff at small strains, or a bond's energy is not smooth.
    """
    found = next(candidates(engine, kind, vectors, cutoff), None)
    if found is not None:
        return found
    raise BackendError(
        f"the bond energies are not smooth up to strains of {0.5 * STRETCH_LIMITS[-1]:.0%}: "
        f"neighbours cross the cutoff {cutoff:g}, or the potential is piecewise, or its table is "
        "too coarse"
    )


def of_cell(cell: Cell) -> tuple[Floats, int] | None:
    """Primitive vectors of the crystal in a cell, and the type of its atoms.

    None if the atoms form no lattice of equal atoms, or the potential is not a sum over pairs. On
    return the cell is at rest.
    """
    engine = cell.engine
    if cell.tolerance is not None or not engine.is_of_distance():
        return None
    cell.deform(np.eye(2))
    x, kinds, edges = engine.vectors("x"), np.unique(engine.atoms("type")), cell.box.T
    vectors = primitive(cell.around())
    if vectors is None or len(kinds) > 1 or len(np.unique(engine.masses())) > 1:
        return None
    numbers = np.rint(edges @ np.linalg.inv(vectors))
    if round(abs(np.linalg.det(numbers))) != len(x):
        return None
    exact = np.asarray(np.linalg.solve(numbers, edges), float)
    fits = bool((Lattice(exact, x[0]).misfit(x) < ON_SITE).all())
    return (exact, int(kinds[0])) if fits else None


def strains(vectors: Floats) -> Floats:
    """``s - 1`` of bonds per Green-Lagrange strain, Voigt, engineering shear; shape ``(m, 3)``."""
    x, y = vectors.T
    return np.asarray(2.0 * np.column_stack([x * x, y * y, x * y]) / (x * x + y * y)[:, None])


def least_curvature(found: Bonds) -> float:
    """Smallest curvature of the lattice energy along rays of strain, divided by that at rest.

    Beyond their limit bonds keep the curvature that they have there.
    """
    rays = shells([1.0], seed=3)
    stretch = rays @ strains(found.vectors).T  # (rays, bonds), per size of the strain
    sizes = np.linspace(0.0, 4.0 * found.stretch_limit, 41)
    curvature = np.zeros((sizes.size, len(rays)))
    for ratio, c in zip(stretch.T, found.energy, strict=True):
        z = np.clip(np.outer(sizes, ratio), -found.stretch_limit, found.stretch_limit)
        curvature += Polynomial([0.0, *c]).deriv(2)(z) * ratio**2
    return float((curvature / curvature[0]).min())


def stable(cell: Cell, vectors: Floats, kind: int) -> Bonds | None:
    """Bonds with the largest limit beyond which the energy of the lattice still grows.

    None if there is no such limit, or if the stress of the strained cell in LAMMPS differs.

    Parameters
    ----------
    vectors : ndarray, shape ``(2, 2)``
    kind : int
        Type of the atoms in the cell; see `of_cell`.
    """
    for found in candidates(cell.engine, kind, vectors, cell.engine.pair_cutoff()):
        if least_curvature(found) >= LEAST_CURVATURE:
            return found if is_whole(found, cell, area(vectors)) else None
    return None


def is_whole(found: Bonds, cell: Cell, size: float) -> bool:
    """Whether the bonds reproduce the stress of the strained cell."""
    _, tau = cell.deform(SAMPLE)
    g = strains(found.vectors)
    E = 0.5 * (SAMPLE.T @ SAMPLE - np.eye(2))
    z = g @ [E[0, 0], E[1, 1], 2.0 * E[0, 1]]
    slope = [Polynomial([0.0, *c]).deriv()(x) for c, x in zip(found.energy, z, strict=True)]
    xx, yy, xy = slope @ g * UNITS[str(cell.engine.lammps.extract_global("units"))].nktv2p / size
    missing = SAMPLE @ [[xx, xy], [xy, yy]] @ SAMPLE.T - tau
    return bool(np.abs(missing).max() < AGREEMENT * np.abs(tau).max())

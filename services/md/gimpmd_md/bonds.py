"""Energies of the bonds of a crystal: LAMMPS's own pair potential as polynomials."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from gimpmd_md.bravais import half_star
from gimpmd_md.engine import Engine
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid import Floats

REACHES = (0.12, 0.1, 0.08, 0.06, 0.04)
"""``|s - 1|`` up to which polynomials are tried, s the square of a bond's stretch."""

DEGREES = range(2, 21)
"""Degrees that are tried, in this order."""

TOLERANCE = 1e-10
"""Error of a bond's force that is accepted, over its largest force within the reach."""

POINTS = 401
"""Distances at which LAMMPS is asked, evenly spaced in s, so that s = 1 is one of them. Enough for
least squares to be stable up to degrees of about twice its square root."""


class Bonds(NamedTuple):
    """Half of an atom's bonds; see ``gimpmd_schemas.case.Crystal``.

    Attributes
    ----------
    vectors : ndarray, shape ``(m, 2)``
        One of each two opposite ones (length).
    energy : list of ndarray
        Coefficients ``c_1, c_2, ...`` of each.
    reach : float
    """

    vectors: Floats
    energy: list[Floats]
    reach: float


def reaches(vectors: Floats, cutoff: float) -> list[float]:
    """Reaches at which no pair of the lattice crosses the cutoff, largest first."""
    R = np.hypot(*half_star(vectors, 2.0 * cutoff).T)
    return [reach for reach in REACHES if (np.abs((cutoff / R) ** 2 - 1.0) > reach).all()]


def bonds(engine: Engine, kind: int, vectors: Floats, cutoff: float, reach: float) -> Bonds | None:
    """Bonds of atoms of a type on a lattice; None if no polynomial serves up to the reach.

    Parameters
    ----------
    kind : int
        LAMMPS's atom type.
    vectors : ndarray, shape ``(2, 2)``
        Reduced basis of the lattice.
    """
    R = half_star(vectors, cutoff)
    length = np.hypot(*R.T)
    shells: list[tuple[float, Floats]] = []
    energy = []
    for size in length:  # ascending: bonds of one length follow each other
        if not shells or size > shells[-1][0] * (1.0 + 1e-9):
            coefficients = polynomial(engine, kind, float(size), reach)
            if coefficients is None:
                return None
            shells.append((float(size), coefficients))
        energy.append(shells[-1][1])
    return Bonds(R, energy, reach)


def polynomial(engine: Engine, kind: int, length: float, reach: float) -> Floats | None:
    """Coefficients ``c_1, c_2, ...`` of a bond's energy, less that at rest, in ``s - 1``.

    The first is LAMMPS's force at rest; the others are fitted to its forces.
    """
    low, high = length * (1.0 - reach) ** 0.5, length * (1.0 + reach) ** 0.5
    r, _, force = engine.pair_table(kind, low, high, POINTS).T
    s = (r / length) ** 2
    slope = -0.5 * force * length**2 / r  # by s
    size = float(np.abs(slope).max())
    if size == 0.0:
        return np.zeros(2)
    rest = POINTS // 2
    for degree in DEGREES:
        fitted = Chebyshev.fit(s - 1.0, slope, degree - 1, domain=[-reach, reach])
        plain = fitted.convert(kind=Polynomial, domain=[-1, 1], window=[-1, 1]).coef
        coefficients = np.zeros(degree)
        coefficients[: plain.size] = plain
        coefficients[0] = slope[rest]
        missing = Polynomial(coefficients)(s - 1.0) - slope
        if np.abs(missing).max() <= TOLERANCE * size:
            return coefficients / np.arange(1.0, degree + 1.0)
    return None


def best(engine: Engine, kind: int, vectors: Floats, cutoff: float) -> Bonds:
    """Bonds with the largest reach there is.

    Raises
    ------
    BackendError
        Neighbours cross the cutoff at small strains, or a bond's energy is not smooth.
    """
    for reach in reaches(vectors, cutoff):
        found = bonds(engine, kind, vectors, cutoff, reach)
        if found is not None:
            return found
    raise BackendError(
        f"the pair potential has no smooth energy of every bond up to strains of "
        f"{0.5 * REACHES[-1]:.0%}: neighbours cross the cutoff {cutoff:g}, or it is joined of "
        "pieces"
    )

"""Strain energy of a crystal: a polynomial in the Green-Lagrange strain, and what lies beyond it.

With E the Green-Lagrange strain in Voigt's notation (engineering shear, twice the tensor's
component) the energy per reference volume is, within the reach of the polynomial,

    W(E) = sum_k P_k(E),   P_k(E) = sum of c_a E^a over all exponents a of total degree k >= 2.

Beyond it, where ``s = |E| / reach > 1`` and ``|E|^2 = E : E``, it goes on quadratically along the
ray from the origin, with value, slope and curvature of the polynomial at the reach:

    W(E) = sum_k P_k(E / s) (1 + k (s - 1) + k (k - 1) / 2 (s - 1)^2).

So there is one smooth energy everywhere, and it grows without bound if the curvature along every
ray is positive at the reach; the atoms' own energy does not, for crystals break.
"""

from __future__ import annotations

from itertools import combinations_with_replacement
from math import comb

import numpy as np

from gimpmd_schemas.arrays import Ints

LOWEST = 2
"""Lowest degree: no energy and no stress at rest."""


def exponents(components: int, degree: int) -> Ints:
    """Exponents of all terms in the order of their coefficients, shape ``(terms, components)``.

    By degree from two up; within one, the first component's exponent falls first. For two
    components and degree 3: (2 0), (1 1), (0 2), (3 0), (2 1), (1 2), (0 3).

    Parameters
    ----------
    components : int
        Of the strain in Voigt's notation: 3 in two dimensions, 6 in three.
    degree : int
        Highest degree.
    """
    return np.array(
        [
            np.bincount(factors, minlength=components)
            for k in range(LOWEST, degree + 1)
            for factors in combinations_with_replacement(range(components), k)
        ],
        dtype=np.int64,
    )


def degree_of(components: int, terms: int) -> int | None:
    """Degree of the polynomial that has so many coefficients; None if there is none."""
    degree, count = LOWEST - 1, 0
    while count < terms:
        degree += 1
        count += comb(degree + components - 1, degree)
    return degree if count == terms and degree >= LOWEST else None

"""Strain energy of a crystal: a polynomial in the Green-Lagrange strain, and its continuation.

Let E be the Green-Lagrange strain in Voigt notation with engineering shear, and ``|E|^2 = E : E``.
Up to ``|E| = strain_limit`` the energy per reference volume is

    W(E) = sum_k P_k(E),   P_k(E) = sum of c_a E^a over all exponents a of total degree k >= 2.

Beyond the limit, where ``s = |E| / strain_limit > 1``, the energy continues quadratically along the
ray from the origin, with the value, the slope and the curvature that the polynomial has at the
limit:

    W(E) = sum_k P_k(E / s) (1 + k (s - 1) + k (k - 1) / 2 (s - 1)^2).

So the energy is smooth everywhere. It grows without bound if the curvature at the limit is positive
along every ray. The energy of the atoms does not grow without bound, since crystals break.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations_with_replacement
from math import comb

import numpy as np

from gimpmd_schemas.arrays import Floats, Ints

LOWEST = 2
"""Lowest degree, since there is no energy and no stress at rest."""


def exponents(components: int, degree: int) -> Ints:
    """Exponents of all terms in the order of their coefficients, shape ``(terms, components)``.

    The degree rises from two. Within a degree, the exponent of the first component falls first.
    The order for two components and degree 3 is (2 0), (1 1), (0 2), (3 0), (2 1), (1 2), (0 3).

    Parameters
    ----------
    components : int
        Number of components of the strain: 3 in two dimensions, 6 in three.
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
    """Degree of the polynomial with this number of coefficients, or None if there is none."""
    degree, count = LOWEST - 1, 0
    while count < terms:
        degree += 1
        count += comb(degree + components - 1, degree)
    return degree if count == terms and degree >= LOWEST else None


def stiffness(components: int, coefficients: Floats | Sequence[float]) -> Floats:
    """Second derivatives of the energy at rest, shape ``(components, components)``.

    Parameters
    ----------
    coefficients : sequence of float
        Those of the quadratic terms, or of all terms.
    """
    C = np.zeros((components, components))
    for a, c in zip(exponents(components, LOWEST), coefficients, strict=False):
        v, w = np.repeat(np.arange(components), a)
        C[v, w] += c
        C[w, v] += c
    return C


def quadratic(stiffness: Floats) -> Floats:
    """Coefficients of the quadratic terms of an energy with this stiffness at rest."""
    v, w = np.triu_indices(len(stiffness))
    return np.where(v == w, 0.5, 1.0) * stiffness[v, w]

"""Random numbers that depend on a site and a step only, and not on the rank that draws them.

The counter-based generator Philox4x32-10 [1]_ turns a counter of four words into four random words.
The counter consists of the site and the step, and the key is the seed. So ranks need not exchange
anything to agree on the numbers.

.. [1] J. K. Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC11 (2011).
"""

from __future__ import annotations

import math

import numpy as np

from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.compiled import njit

ROUNDS = 10
_WORD, _LOW = np.uint64(32), np.uint64(0xFFFFFFFF)
_MULTIPLIERS = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_WEYL = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_UNUSED, _ONE, _TWO, _UNIT = np.uint64(11), np.uint64(1), np.uint64(2), 2.0**-53
"""A double takes 53 of 64 random bits."""


def normals(seed: int, step: int, sites: Ints) -> Floats:
    """Draw standard normal numbers, one for each axis of each site, by the Box-Muller method.

    Parameters
    ----------
    seed : int
        Taken modulo 2^64.
    step : int
        Taken modulo 2^64 in two dimensions and 2^31 in three.
    sites : ndarray of int64, shape ``(n, d)``
        Taken modulo 2^32.

    Returns
    -------
    ndarray, shape ``(n, d)``
    """
    out = np.empty(sites.shape)
    key, time = (np.uint64(value % 2**64) for value in (seed, step))
    fill = _fill_plane if sites.shape[1] == 2 else _fill_space
    fill(key, time, sites.astype(np.uint64), out)
    return out


@njit(cache=True)
def _fill_plane(seed, step, sites, out):  # type: ignore[no-untyped-def]
    for a in range(sites.shape[0]):
        words = philox(
            sites[a, 0] & _LOW, sites[a, 1] & _LOW, step & _LOW, step >> _WORD,
            seed & _LOW, seed >> _WORD,
        )  # fmt: skip
        out[a, 0], out[a, 1] = _two_normals(words)


@njit(cache=True)
def _fill_space(seed, step, sites, out):  # type: ignore[no-untyped-def]
    for a in range(sites.shape[0]):
        for draw in range(2):
            words = philox(
                sites[a, 0] & _LOW, sites[a, 1] & _LOW, sites[a, 2] & _LOW,
                (_TWO * step + np.uint64(draw)) & _LOW,
                seed & _LOW, seed >> _WORD,
            )  # fmt: skip
            first, second = _two_normals(words)
            if draw == 0:
                out[a, 0], out[a, 1] = first, second
            else:
                out[a, 2] = first


@njit(inline="always")
def _two_normals(w):  # type: ignore[no-untyped-def]
    # the uniform number lies in (0, 1], so that its logarithm is finite
    uniform = _UNIT * ((((w[0] << _WORD) | w[1]) >> _UNUSED) + _ONE)
    radius = math.sqrt(-2.0 * math.log(uniform))
    angle = 2.0 * math.pi * _UNIT * (((w[2] << _WORD) | w[3]) >> _UNUSED)
    return radius * math.cos(angle), radius * math.sin(angle)


@njit(cache=True)
def philox(c0, c1, c2, c3, k0, k1):  # type: ignore[no-untyped-def]
    """Compute four random words of 32 bits from a counter and a key; all are ``uint64``."""
    for _ in range(ROUNDS):
        p, q = _MULTIPLIERS[0] * c0, _MULTIPLIERS[1] * c2
        c0, c1, c2, c3 = (q >> _WORD) ^ c1 ^ k0, q & _LOW, (p >> _WORD) ^ c3 ^ k1, p & _LOW
        k0, k1 = (k0 + _WEYL[0]) & _LOW, (k1 + _WEYL[1]) & _LOW
    return c0, c1, c2, c3

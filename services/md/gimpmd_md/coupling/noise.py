"""Random numbers that belong to a place and a step, whatever rank draws them.

The counter-based generator Philox4x32-10 [1]_ turns a counter of four words into four random ones.
The counter is site and step, the key the seed, so a patch needs to know of no other.

.. [1] J. K. Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC11 (2011).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from gimpmd_schemas.arrays import Floats, Ints

ROUNDS = 10
_WORD, _LOW = np.uint64(32), np.uint64(0xFFFFFFFF)
_MULTIPLIERS = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_WEYL = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_SPARE, _ONE, _UNIT = np.uint64(11), np.uint64(1), 2.0**-53
"""Of 64 random bits a double takes 53."""


def normals(seed: int, step: int, sites: Ints) -> Floats:
    """Two standard normal numbers for each site, by Box and Muller.

    Parameters
    ----------
    seed, step : int
        Taken modulo 2^64.
    sites : ndarray of int64, shape ``(n, 2)``
        Taken modulo 2^32.

    Returns
    -------
    ndarray, shape ``(n, 2)``
    """
    out = np.empty((len(sites), 2))
    key, time = (np.uint64(value % 2**64) for value in (seed, step))
    _fill(key, time, sites.astype(np.uint64), out)
    return out


@njit(cache=True)
def _fill(seed, step, sites, out):  # type: ignore[no-untyped-def]
    for a in range(sites.shape[0]):
        w = philox(
            sites[a, 0] & _LOW, sites[a, 1] & _LOW, step & _LOW, step >> _WORD,
            seed & _LOW, seed >> _WORD,
        )  # fmt: skip
        # in (0, 1], so that its logarithm is finite
        radius = math.sqrt(-2.0 * math.log(_UNIT * ((((w[0] << _WORD) | w[1]) >> _SPARE) + _ONE)))
        angle = 2.0 * math.pi * _UNIT * (((w[2] << _WORD) | w[3]) >> _SPARE)
        out[a, 0], out[a, 1] = radius * math.cos(angle), radius * math.sin(angle)


@njit(cache=True)
def philox(c0, c1, c2, c3, k0, k1):  # type: ignore[no-untyped-def]
    """Four random words of 32 bits, of counter and key; all are ``uint64``."""
    for _ in range(ROUNDS):
        p, q = _MULTIPLIERS[0] * c0, _MULTIPLIERS[1] * c2
        c0, c1, c2, c3 = (q >> _WORD) ^ c1 ^ k0, q & _LOW, (p >> _WORD) ^ c3 ^ k1, p & _LOW
        k0, k1 = (k0 + _WEYL[0]) & _LOW, (k1 + _WEYL[1]) & _LOW
    return c0, c1, c2, c3

"""Sums of what is conserved, over the atoms of this rank."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

Array = np.ndarray[Any, np.dtype[Any]]


@njit(cache=True)
def tally(
    part: Array, bits: int, m: Array, v: Array, potential: Array, reference: Array
) -> tuple[float, float, float, float, float]:
    """Sum over the atoms that have one of the bits.

    Parameters
    ----------
    part : ndarray of int, shape ``(n,)``
    bits : int
    m, potential, reference : ndarray, shape ``(n,)``
        Mass, potential energy, and potential energy at rest.
    v : ndarray, shape ``(n, 2)``

    Returns
    -------
    mass, momentum_x, momentum_y, twice_kinetic, potential : float
        ``twice_kinetic`` is ``sum m v^2``, in mechanical units; ``potential`` is that above rest.
    """
    mass, px, py, twice_kinetic, energy = 0.0, 0.0, 0.0, 0.0, 0.0
    for a in range(part.shape[0]):
        if part[a] & bits:
            mass += m[a]
            px += m[a] * v[a, 0]
            py += m[a] * v[a, 1]
            twice_kinetic += m[a] * (v[a, 0] * v[a, 0] + v[a, 1] * v[a, 1])
            energy += potential[a] - reference[a]
    return mass, px, py, twice_kinetic, energy

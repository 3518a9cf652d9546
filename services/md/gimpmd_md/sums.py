"""Sums over the atoms of this rank: what is conserved, work, and the motion over a window."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.grid.background import BackgroundGrid

Array = np.ndarray[Any, np.dtype[Any]]


@njit(cache=True)
def tally(
    part: Array, bits: int, m: Array, v: Array, bonded: int, potential: Array, reference: Array
) -> tuple[float, float, float, float, float]:
    """Sum over the atoms that have one of the bits.

    Parameters
    ----------
    part : ndarray of int, shape ``(n,)``
    bits, bonded : int
        Whose mass, momentum and kinetic energy count, and whose potential energy.
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
        if part[a] & bonded:
            energy += potential[a] - reference[a]
    return mass, px, py, twice_kinetic, energy


@njit(cache=True)
def power(part: Array, bits: int, v: Array, f: Array) -> float:
    """``sum v f`` over the atoms that have one of the bits; ``v`` and ``f`` of shape ``(n, 2)``."""
    total = 0.0
    for a in range(part.shape[0]):
        if part[a] & bits:
            total += v[a, 0] * f[a, 0] + v[a, 1] * f[a, 1]
    return total


@njit(cache=True)
def mean_velocity(x: Array, last: Array, period: Array, span: float, q: Array) -> None:
    """Velocity of the way from ``last`` to ``x``, both ``(n, 2)``; across periodic faces the short.

    Parameters
    ----------
    period : ndarray, shape ``(2,)``
        Length of the box, 0 where it is not periodic.
    span : float
        The time it took.
    q : ndarray, shape ``(n, 2)``
        The result.
    """
    for a in range(x.shape[0]):
        for axis in range(2):
            moved = x[a, axis] - last[a, axis]
            if period[axis] > 0.0:
                moved -= period[axis] * np.round(moved / period[axis])
            q[a, axis] = moved / span


def periods(grid: BackgroundGrid) -> Floats:
    """Length of the domain along each axis, 0 where it is not periodic; shape ``(2,)``."""
    return np.where(grid.periodic, np.array(grid.cells) * grid.cell, 0.0)

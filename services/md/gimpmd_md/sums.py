"""Sums over the atoms of this rank, their mean velocity, and the extent of all atoms."""

from __future__ import annotations

from typing import Any

import numpy as np

from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.compiled import njit
from gimpmd_schemas.grid.background import BackgroundGrid

Array = np.ndarray[Any, np.dtype[Any]]


@njit(inline="always")
def _dot(v, w, a):  # type: ignore[no-untyped-def]
    """Scalar product of two vectors of an atom, in two or three dimensions."""
    product = v[a, 0] * w[a, 0] + v[a, 1] * w[a, 1]
    if v.shape[1] == 3:
        product += v[a, 2] * w[a, 2]
    return product


@njit(cache=True)
def tally(
    role: Array, bits: int, m: Array, v: Array, bonded: int, potential: Array
) -> tuple[float, Array, float, float]:
    """Sum mass, momentum and energies over atoms.

    Parameters
    ----------
    role : ndarray of int, shape ``(n,)``
    bits : int
        Role bits of the atoms whose mass, momentum and kinetic energy count.
    m, potential : ndarray, shape ``(n,)``
        Mass and potential energy.
    v : ndarray, shape ``(n, d)``
        Velocity.
    bonded : int
        Role bits of the atoms whose potential energy counts.

    Returns
    -------
    mass : float
    momentum : ndarray, shape ``(d,)``
    twice_kinetic : float
        ``sum m v^2`` (mechanical units).
    potential : float
    """
    mass, twice_kinetic, energy = 0.0, 0.0, 0.0
    px, py, pz = 0.0, 0.0, 0.0  # scalars stay in registers; an array would not
    for a in range(role.shape[0]):
        if role[a] & bits:
            mass += m[a]
            twice_kinetic += m[a] * _dot(v, v, a)
            px += m[a] * v[a, 0]
            py += m[a] * v[a, 1]
            if v.shape[1] == 3:
                pz += m[a] * v[a, 2]
        if role[a] & bonded:
            energy += potential[a]
    momentum = np.array([px, py, pz])[: v.shape[1]]
    return mass, momentum, twice_kinetic, energy


@njit(cache=True)
def power(role: Array, bits: int, v: Array, f: Array) -> float:
    """``sum v f`` over the atoms with one of the bits; ``v`` and ``f`` have shape ``(n, d)``."""
    total = 0.0
    for a in range(role.shape[0]):
        if role[a] & bits:
            total += _dot(v, f, a)
    return total


@njit(cache=True)
def power_of(rows: Array, v: Array, f: Array) -> float:
    """``sum v f`` over the atoms in some rows; ``v`` and ``f`` have shape ``(n, d)``."""
    total = 0.0
    for k in range(rows.size):
        total += _dot(v, f, rows[k])
    return total


@njit(cache=True)
def mean_velocity(x: Array, last: Array, period: Array, span: float, q: Array) -> None:
    """Mean velocity from ``last`` to ``x`` (minimum image).

    Parameters
    ----------
    x, last : ndarray, shape ``(n, d)``
        Positions at the end and at the start.
    period : ndarray, shape ``(d,)``
        Length of the box, 0 where it is not periodic.
    span : float
        Time between the two.
    q : ndarray, shape ``(n, d)``
        The result.
    """
    for a in range(x.shape[0]):
        for axis in range(x.shape[1]):
            moved = x[a, axis] - last[a, axis]
            if period[axis] > 0.0:
                moved -= period[axis] * np.round(moved / period[axis])
            q[a, axis] = moved / span


def periods(grid: BackgroundGrid) -> Floats:
    """Length of the domain along each axis, 0 where it is not periodic; shape ``(d,)``."""
    return np.where(grid.periodic, np.array(grid.cells) * grid.cell, 0.0)


def extent(comm: Any, x: Floats) -> tuple[Floats, Floats]:
    """Smallest and largest coordinates of the positions ``(n, d)`` of all ranks; collective.

    They are ``inf`` and ``-inf`` if no rank has an atom.
    """
    bounds = np.array([x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf)])
    ranks = np.array(comm.allgather(bounds))
    return ranks[:, 0].min(axis=0), ranks[:, 1].max(axis=0)


def spacing_of(mass: float, count: int, density: float, dim: int) -> float:
    """Distance of neighbouring atoms (length): the d-th root of the volume per atom.

    Parameters
    ----------
    mass : float
        Total mass of the atoms.
    count : int
        Number of atoms.
    density : float
        Mass per area in two dimensions, per volume in three.
    """
    return float((mass / count / density) ** (1.0 / dim))

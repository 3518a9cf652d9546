"""Displacement gradient of atoms over a background grid (paper Eqs. 5 to 7, 9 to 14).

Displacements of atoms are summed to the nodes of an Eulerian grid with the generalized
interpolation function; its gradient takes them back to the atoms. One source serves two and
three dimensions, tilted and periodic boxes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numba import njit

from gimpmd_md.strain.box import Configuration, halfway
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_schemas.grid import Bools, Floats, Ints
from gimpmd_schemas.interpolation import stencil

Weights = Literal["linear", "gimp"]

MAX_NODES = 50_000_000
"""Most nodes of a grid, 3 GB of sums: a body, not a few atoms that flew away, should fill it."""

LEAST_SPREAD = 0.1
"""Smallest accepted singular value of ``A``: below, the atoms near do not span all directions.

Inside a body all are one, at a plane surface the smallest is about 0.3; a lone row or a pair of
atoms has zero.
"""


@dataclass(frozen=True)
class GridOptions:
    """How strain is taken over the grid.

    Attributes
    ----------
    cell : float
        Edge of a cell (length units); periodic edges get the nearest whole number of cells.
    spacing : float
        Edge of the cube that an atom is, at most one cell.
    weights : {"linear", "gimp"}
        ``gimp`` are the paper's; ``linear`` are corrected so that linear fields are exact
        everywhere, at free surfaces too.
    """

    cell: float
    spacing: float
    weights: Weights = "linear"


@dataclass(frozen=True)
class _Grid:
    """Nodes ``origin + edges @ k`` for whole k from ``first`` on; those of periodic axes repeat."""

    origin: Floats
    edges: Floats
    first: Ints
    shape: Ints
    periodic: Bools


def total_gradient(
    reference: Configuration, now: Configuration, m: Floats, options: GridOptions, comm: Any
) -> Floats:
    """Gradient of the displacement ``u = x - X`` with respect to X; collective.

    Grid and weights are those of the reference, so the result depends on the two configurations
    alone and does not drift.

    Parameters
    ----------
    reference, now : Configuration
        The same atoms, in the same order: this rank's part of them.
    m : ndarray, shape ``(n,)``
        Masses.
    options : GridOptions
    comm : mpi4py communicator
        Of all ranks that hold a part.

    Returns
    -------
    ndarray, shape ``(n, d, d)``
        ``du_i / dX_j``; NaN where an atom has too few others near.

    Raises
    ------
    InputError
        The atoms are spread too far for a grid of this cell.
    """
    return _gradient(reference, reference, now, m, options, comm)


def increment_gradient(
    before: Configuration, now: Configuration, m: Floats, options: GridOptions, comm: Any
) -> Floats:
    """Gradient of the displacement between two times, taken midway between them; collective.

    It is the time step times the gradient of the atoms' mean velocity (paper Eqs. 5 and 7), which
    unlike a velocity at an instant carries the displacement exactly. See ``total_gradient``.
    """
    return _gradient(halfway(before, now), before, now, m, options, comm)


def _gradient(
    where: Configuration,
    before: Configuration,
    now: Configuration,
    m: Floats,
    options: GridOptions,
    comm: Any,
) -> Floats:
    # what periodic edges do is linear and exact; what is left repeats with them
    periodic = where.box.periodic
    stretched = np.where(periodic, now.box.edges - before.box.edges, 0.0)
    moved = np.where(periodic, now.box.origin - before.box.origin, 0.0)
    with_box = stretched @ np.linalg.inv(where.box.edges)
    u = now.x - before.x - moved - (where.x - where.box.origin) @ with_box.T

    grid = _grid_over(where, options, comm)
    cells = (where.x - grid.origin) @ np.linalg.inv(grid.edges).T
    # a periodic edge may be shorter than an atom
    half = np.minimum(0.5 * options.spacing / np.linalg.norm(grid.edges, axis=0), 0.5)
    d = cells.shape[1]
    sums = np.zeros((int(np.prod(grid.shape)), 1 + 2 * d))
    _scatter(cells, half, grid.first, grid.shape, grid.periodic, m, u, sums)
    _sum_over(comm, sums)
    mass = sums[:, :1]
    sums[:, 1:] = np.divide(sums[:, 1:], mass, out=np.zeros_like(sums[:, 1:]), where=mass > 0.0)

    gradient, A = np.empty((len(m), d, d)), np.empty((len(m), d, d))
    _gather(cells, half, grid.first, grid.shape, grid.periodic, sums, gradient, A)
    if options.weights == "linear":
        gradient = _divided(gradient, A)
    return gradient @ np.linalg.inv(grid.edges) + with_box


def _grid_over(where: Configuration, options: GridOptions, comm: Any) -> _Grid:
    """The grid that the atoms of all ranks touch."""
    box = where.box
    length = np.linalg.norm(box.edges, axis=0)
    count = np.where(box.periodic, np.maximum(np.round(length / options.cell), 1.0), 1.0)
    edges = box.edges * np.where(box.periodic, 1.0 / count, options.cell / length)
    cells = (where.x - box.origin) @ np.linalg.inv(edges).T
    low, high = _extent(comm, cells)
    first = np.where(box.periodic, 0.0, np.floor(low + 0.5) - 1.0)
    shape = np.where(box.periodic, count, np.floor(high + 0.5) + 2.0 - first)
    if not np.isfinite(high - low).all():
        hint = "look at the temperature of the run: it may be unstable"
        raise InputError("atomic strain", [Problem("x", None, "an atom is nowhere (nan)", hint)])
    if np.prod(shape) > MAX_NODES:
        hint = "raise it, or leave atoms that have flown away out of the dump"
        nodes = " x ".join(f"{n:.0f}" for n in shape)
        raise InputError(
            "atomic strain",
            [Problem("cell", options.cell, f"the atoms spread over {nodes} nodes", hint)],
        )
    return _Grid(box.origin, edges, first.astype(np.int64), shape.astype(np.int64), box.periodic)


def _extent(comm: Any, cells: Floats) -> tuple[Floats, Floats]:
    """Least and greatest coordinates of the atoms of all ranks."""
    from mpi4py import MPI

    d = cells.shape[1]
    low = cells.min(axis=0, initial=np.inf) if len(cells) else np.full(d, np.inf)
    high = cells.max(axis=0, initial=-np.inf) if len(cells) else np.full(d, -np.inf)
    low, high = np.nan_to_num(low, nan=-np.inf), np.nan_to_num(high, nan=np.inf, posinf=np.inf)
    comm.Allreduce(MPI.IN_PLACE, low, op=MPI.MIN)
    comm.Allreduce(MPI.IN_PLACE, high, op=MPI.MAX)
    return low, high


def _sum_over(comm: Any, sums: Floats) -> None:
    from mpi4py import MPI

    if comm.size > 1:
        comm.Allreduce(MPI.IN_PLACE, sums, op=MPI.SUM)


def _divided(gradient: Floats, A: Floats) -> Floats:
    """``gradient @ A^-1``, NaN where A is nearly singular."""
    spread = np.linalg.svd(A, compute_uv=False)[:, -1]
    poor = spread < LEAST_SPREAD
    A[poor] = np.eye(A.shape[1])
    divided = gradient @ np.linalg.inv(A)
    divided[poor] = np.nan
    return divided


@njit(cache=True)
def _touch(
    at: Floats,
    half: Floats,
    first: Ints,
    shape: Ints,
    periodic: Bools,
    nodes: Ints,
    S: Floats,
    dS: Floats,
    away: Floats,
) -> None:
    """Of the ``3^d`` nodes that an atom touches: number, weight, its gradient, and the offset."""
    d = at.shape[0]
    nodes[:] = 0
    S[:] = 1.0
    dS[:] = 1.0
    for k in range(d):
        base, s0, s1, s2, g0, g1, g2 = stencil(at[k], half[k])
        stride = 3**k
        for c in range(3**d):
            place = (c // stride) % 3
            index = base + place
            away[c, k] = at[k] - index
            index -= first[k]
            if periodic[k]:
                index %= shape[k]
            nodes[c] = nodes[c] * shape[k] + index
            s = s0 if place == 0 else (s1 if place == 1 else s2)
            g = g0 if place == 0 else (g1 if place == 1 else g2)
            S[c] *= s
            for i in range(d):
                dS[c, i] *= g if i == k else s


@njit(cache=True)
def _scatter(
    cells: Floats,
    half: Floats,
    first: Ints,
    shape: Ints,
    periodic: Bools,
    m: Floats,
    u: Floats,
    sums: Floats,
) -> None:
    """Add to each node the mass ``sum S m``, its moment ``sum S m (xi - i)``, and ``sum S m u``."""
    d = cells.shape[1]
    count = 3**d
    nodes, S = np.empty(count, np.int64), np.empty(count)
    dS, away = np.empty((count, d)), np.empty((count, d))
    for a in range(cells.shape[0]):
        _touch(cells[a], half, first, shape, periodic, nodes, S, dS, away)
        for c in range(count):
            mass = S[c] * m[a]
            i = nodes[c]
            sums[i, 0] += mass
            for k in range(d):
                sums[i, 1 + k] += mass * away[c, k]
                sums[i, 1 + d + k] += mass * u[a, k]


@njit(cache=True)
def _gather(
    cells: Floats,
    half: Floats,
    first: Ints,
    shape: Ints,
    periodic: Bools,
    fields: Floats,
    gradient: Floats,
    A: Floats,
) -> None:
    """``sum_i u_i grad S_ia``, and ``A = 1 + sum_i c_i grad S_ia``, in units of cells.

    A node's mean displacement u_i belongs to the centre of mass of its atoms, which lies off the
    node by c_i. A linear field ``u = G xi`` therefore gives ``G A``.
    """
    d = cells.shape[1]
    count = 3**d
    nodes, S = np.empty(count, np.int64), np.empty(count)
    dS, away = np.empty((count, d)), np.empty((count, d))
    for a in range(cells.shape[0]):
        _touch(cells[a], half, first, shape, periodic, nodes, S, dS, away)
        for k in range(d):
            for j in range(d):
                slope, offset = 0.0, 1.0 if k == j else 0.0
                for c in range(count):
                    offset += fields[nodes[c], 1 + k] * dS[c, j]
                    slope += fields[nodes[c], 1 + d + k] * dS[c, j]
                A[a, k, j] = offset
                gradient[a, k, j] = slope

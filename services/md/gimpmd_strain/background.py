"""Displacement gradient of atoms over a background grid (paper Eqs. 5 to 7, 9 to 14).

Displacements of atoms are summed to the nodes of an Eulerian grid with the generalized
interpolation function; its gradient takes them back to the atoms. One source serves two and
three dimensions, tilted and periodic boxes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numba import njit

from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_schemas.grid.interpolation import stencil
from gimpmd_strain.box import Configuration, halfway

Weights = Literal["linear", "quadratic", "gimp"]

MAX_NODES = 50_000_000
"""Most nodes of a grid, 3 GB of sums: a body, not a few atoms that flew away, should fill it."""

LEAST_SPREAD = 0.1
"""Smallest accepted singular value of ``A``: below, the atoms near do not span all directions.

Inside a body all are one, at a plane surface the smallest is about 0.3; a lone row or a pair of
atoms has zero.
"""


CORRECTIONS = 4
"""Of the quadratic weights; each halves what is left of the error of a quadratic field."""


@dataclass(frozen=True)
class GridOptions:
    """How strain is taken over the grid.

    Attributes
    ----------
    cell : float
        Edge of a cell (length units); periodic edges get the nearest whole number of cells.
    spacing : float
        Edge of the cube that an atom is, at most one cell.
    weights : {"linear", "quadratic", "gimp"}
        ``gimp`` are the paper's; ``linear`` are corrected so that linear fields are exact
        everywhere, at free surfaces too. ``quadratic`` besides extrapolates to a surface what
        cells see below it, at two to three times the cost and with more noise there.
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
    places = _Places(cells, half, grid.first, grid.shape, grid.periodic)
    if options.weights == "gimp":
        gradient = _slope(places, m, u, comm)
    else:
        gradient = _corrected(places, m, u, options.weights == "quadratic", comm)
    return gradient @ np.linalg.inv(grid.edges) + with_box


class _Places(NamedTuple):
    """Where atoms are on a grid: positions and half-widths in cells, and the grid's nodes."""

    cells: Floats
    half: Floats
    first: Ints
    shape: Ints
    periodic: Bools


def _slope(places: _Places, m: Floats, field: Floats, comm: Any) -> Floats:
    """``sum_i f_i grad S_ia`` with ``f_i = sum S m f / sum S m``; shape ``(n, k, d)``, per cell."""
    nodal = _averages(places, m, field, comm)
    slope = np.empty((*field.shape, places.cells.shape[1]))
    _gather(places, nodal, slope)
    return slope


def _averages(places: _Places, m: Floats, field: Floats, comm: Any) -> Floats:
    """Mass-weighted averages of a field over the atoms of each node."""
    sums = np.zeros((int(np.prod(places.shape)), 1 + field.shape[1]))
    _scatter(places, m, field, sums)
    return _over_mass(sums, comm)


def _corrected(places: _Places, m: Floats, u: Floats, quadratic: bool, comm: Any) -> Floats:
    """Gradient that is exact for linear fields, and nearly so for quadratic ones.

    A node's average belongs to the centre of mass of its atoms, which lies off the node by c_i. A
    linear field ``u = G xi`` therefore gives ``G A`` with ``A = 1 + sum_i c_i grad S_ia``, whose
    inverse makes it right. A quadratic field besides gives its second derivatives times a lever T
    from the nodes' second moments, which is zero inside a body and about half a cell at its
    surface; the derivatives are those of the gradient itself.
    """
    n, d = places.cells.shape
    columns = 1 + d + (d * d if quadratic else 0)
    moments = np.zeros((int(np.prod(places.shape)), columns))
    _scatter_moments(places, m, moments)
    moments = _over_mass(moments, comm)
    A = np.empty((n, d, d))
    _gather_matrix(places, moments, A)
    poor = np.linalg.svd(A, compute_uv=False)[:, -1] < LEAST_SPREAD
    A[poor] = np.eye(d)
    inverse = np.linalg.inv(A)

    first = gradient = _slope(places, m, u, comm) @ inverse
    if quadratic:
        T = np.empty((n, d, d, d))
        _gather_lever(places, moments, T)
        T = T @ inverse[:, None]
        good = np.where(poor, 0.0, m)
        for _ in range(CORRECTIONS):
            second = _slope(places, good, gradient.reshape(n, d * d), comm) @ inverse
            second = second.reshape(n, d, d, d)
            second = 0.5 * (second + np.swapaxes(second, 2, 3))
            gradient = first - np.einsum("nmkl,nklj->nmj", second, T)
    gradient[poor] = np.nan
    return gradient


def _over_mass(sums: Floats, comm: Any) -> Floats:
    """All columns but the first over the first, summed over the ranks; zero without mass."""
    from mpi4py import MPI

    if comm.size > 1:
        comm.Allreduce(MPI.IN_PLACE, sums, op=MPI.SUM)
    rest, mass = sums[:, 1:], sums[:, :1]
    return np.divide(rest, mass, out=np.zeros_like(rest), where=mass > 0.0)


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
def _scatter(places: _Places, m: Floats, field: Floats, sums: Floats) -> None:
    """Add to each node the mass ``sum S m``, and ``sum S m f``."""
    cells, half, first, shape, periodic = places
    d = cells.shape[1]
    count = 3**d
    nodes, S = np.empty(count, np.int64), np.empty(count)
    dS, away = np.empty((count, d)), np.empty((count, d))
    for a in range(cells.shape[0]):
        _touch(cells[a], half, first, shape, periodic, nodes, S, dS, away)
        for c in range(count):
            mass = S[c] * m[a]
            sums[nodes[c], 0] += mass
            for k in range(field.shape[1]):
                sums[nodes[c], 1 + k] += mass * field[a, k]


@njit(cache=True)
def _scatter_moments(places: _Places, m: Floats, sums: Floats) -> None:
    """Add the mass, its first moments about the node, and the second if there is room."""
    cells, half, first, shape, periodic = places
    d = cells.shape[1]
    count = 3**d
    nodes, S = np.empty(count, np.int64), np.empty(count)
    dS, away = np.empty((count, d)), np.empty((count, d))
    for a in range(cells.shape[0]):
        _touch(cells[a], half, first, shape, periodic, nodes, S, dS, away)
        for c in range(count):
            mass = S[c] * m[a]
            sums[nodes[c], 0] += mass
            for k in range(d):
                sums[nodes[c], 1 + k] += mass * away[c, k]
            if sums.shape[1] > 1 + d:
                for k in range(d):
                    for j in range(d):
                        sums[nodes[c], 1 + d + k * d + j] += mass * away[c, k] * away[c, j]


@njit(cache=True)
def _gather(places: _Places, nodal: Floats, slope: Floats) -> None:
    """``sum_i f_i grad S_ia``."""
    cells, half, first, shape, periodic = places
    d = cells.shape[1]
    count = 3**d
    nodes, S = np.empty(count, np.int64), np.empty(count)
    dS, away = np.empty((count, d)), np.empty((count, d))
    for a in range(cells.shape[0]):
        _touch(cells[a], half, first, shape, periodic, nodes, S, dS, away)
        for k in range(nodal.shape[1]):
            for j in range(d):
                sum_ = 0.0
                for c in range(count):
                    sum_ += nodal[nodes[c], k] * dS[c, j]
                slope[a, k, j] = sum_


@njit(cache=True)
def _gather_matrix(places: _Places, moments: Floats, A: Floats) -> None:
    """``A = 1 + sum_i c_i grad S_ia``."""
    cells, half, first, shape, periodic = places
    d = cells.shape[1]
    count = 3**d
    nodes, S = np.empty(count, np.int64), np.empty(count)
    dS, away = np.empty((count, d)), np.empty((count, d))
    for a in range(cells.shape[0]):
        _touch(cells[a], half, first, shape, periodic, nodes, S, dS, away)
        for k in range(d):
            for j in range(d):
                sum_ = 1.0 if k == j else 0.0
                for c in range(count):
                    sum_ += moments[nodes[c], k] * dS[c, j]
                A[a, k, j] = sum_


@njit(cache=True)
def _gather_lever(places: _Places, moments: Floats, T: Floats) -> None:
    """``sum_i <(xi - xi_a)_k (xi - xi_a)_l>_i grad_j S_ia / 2``, averages of the nodes' atoms."""
    cells, half, first, shape, periodic = places
    d = cells.shape[1]
    count = 3**d
    nodes, S = np.empty(count, np.int64), np.empty(count)
    dS, away = np.empty((count, d)), np.empty((count, d))
    for a in range(cells.shape[0]):
        _touch(cells[a], half, first, shape, periodic, nodes, S, dS, away)
        for k in range(d):
            for l in range(d):  # noqa: E741
                for j in range(d):
                    T[a, k, l, j] = 0.0
                for c in range(count):
                    i = nodes[c]
                    about = moments[i, d + k * d + l] + away[c, k] * away[c, l]
                    about -= moments[i, k] * away[c, l] + moments[i, l] * away[c, k]
                    for j in range(d):
                        T[a, k, l, j] += 0.5 * about * dS[c, j]

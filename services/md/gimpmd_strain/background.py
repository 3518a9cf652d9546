"""Displacement gradient of atoms from a background grid (paper Eqs. 5 to 7, 9 to 14).

The displacements of the atoms are averaged at the nodes of an Eulerian grid with the generalized
interpolation function. The gradient of this function gives the displacement gradient at the atoms.
The code works in two and three dimensions, and with tilted and periodic boxes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.compiled import njit
from gimpmd_schemas.errors import InputError, Problem
from gimpmd_schemas.grid.particle_grid import (
    Window,
    gather_gradient,
    gimp_gradients,
    gimp_offsets,
    gimp_stencil,
    scatter,
)
from gimpmd_strain.box import Configuration, halfway

Weights = Literal["linear", "quadratic", "gimp"]

MAX_NODES = 50_000_000
"""Largest number of nodes of a grid (3 GB of sums).

A body stays below. A few atoms that flew away do not, and they would fill the memory.
"""

LEAST_SPREAD = 0.1
"""Smallest accepted singular value of ``A``.

Below this value the atoms nearby do not span all directions, and the strain is undefined. Inside a
body all singular values are one, and at a plane surface the smallest is about 0.3. For a single row
or pair of atoms it is zero.
"""

CORRECTIONS = 4
"""Corrections of the quadratic weights; each halves the error for a quadratic field."""


@dataclass(frozen=True)
class GridOptions:
    """Grid and weights of the strain.

    Attributes
    ----------
    cell : float
        Edge of a cell (length units). A periodic edge of the box is divided into the nearest whole
        number of cells.
    spacing : float
        Edge of the cube that represents an atom (length units), at most one cell.
    weights : {"linear", "quadratic", "gimp"}
        ``gimp`` are the weights of the paper. ``linear`` corrects them, so that linear fields are
        exact everywhere, also at free surfaces. ``quadratic`` also extrapolates the strain of the
        cells below a free surface to the surface; this takes two to three times as long and is
        noisier there.
    """

    cell: float
    spacing: float
    weights: Weights = "linear"


@dataclass(frozen=True)
class _Grid:
    """A grid whose node of indices k lies at ``origin + edges @ k``."""

    origin: Floats
    edges: Floats
    window: Window


def total_gradient(
    reference: Configuration, now: Configuration, m: Floats, options: GridOptions, comm: Any
) -> Floats:
    """Gradient of the displacement ``u = x - X`` with respect to X; collective.

    Grid and weights belong to the reference. So the result depends on the two configurations only
    and does not drift.

    Parameters
    ----------
    reference, now : Configuration
        The atoms of this rank, in the same order.
    m : ndarray, shape ``(n,)``
        Masses.
    options : GridOptions
    comm : mpi4py communicator or None
        Its ranks hold the parts of the body. None: this process holds all of it.

    Returns
    -------
    ndarray, shape ``(n, d, d)``
        ``du_i / dX_j``; NaN where an atom has too few neighbours.

    Raises
    ------
    InputError
        The atoms are too far apart for a grid of this cell.
    """
    return _gradient(reference, reference, now, m, options, comm)


def increment_gradient(
    before: Configuration, now: Configuration, m: Floats, options: GridOptions, comm: Any
) -> Floats:
    """Gradient of the displacement between two times, on the configuration midway; collective.

    It equals the time step times the gradient of the mean velocity of the atoms (paper Eqs. 5 and
    7). Unlike the velocity at an instant, the mean velocity gives the displacement exactly. See
    ``total_gradient`` for the parameters.
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
    # the deformation of the periodic edges is linear and exact; the remainder is periodic
    periodic = where.box.periodic
    stretched = np.where(periodic, now.box.edges - before.box.edges, 0.0)
    moved = np.where(periodic, now.box.origin - before.box.origin, 0.0)
    with_box = stretched @ np.linalg.inv(where.box.edges)
    u = now.x - before.x - moved - (where.x - where.box.origin) @ with_box.T

    grid = _grid_over(where, options, comm)
    cells = (where.x - grid.origin) @ np.linalg.inv(grid.edges).T
    # a periodic edge may be shorter than an atom
    half = np.minimum(0.5 * options.spacing / np.linalg.norm(grid.edges, axis=0), 0.5)
    places = _Places(cells, half, grid.window)
    if options.weights == "gimp":
        gradient = _slope(places, m, u, comm)
    else:
        gradient = _corrected(places, m, u, options.weights == "quadratic", comm)
    return gradient @ np.linalg.inv(grid.edges) + with_box


class _Places(NamedTuple):
    """Positions ``(n, d)`` and half-widths ``(d,)`` of atoms in cells, and the grid's nodes."""

    cells: Floats
    half: Floats
    window: Window


def _slope(places: _Places, m: Floats, field: Floats, comm: Any) -> Floats:
    """``sum_i f_i grad S_ia`` with ``f_i = sum S m f / sum S m``; shape ``(n, k, d)``, per cell."""
    sums = np.zeros((math.prod(places.window.shape), 1 + field.shape[1]))
    _sum_field(places, m, field, sums)
    nodal = _over_mass(sums, comm)
    slope = np.empty((*field.shape, places.cells.shape[1]))
    _gradient_at_atoms(places, nodal, field.shape[1], slope)
    return slope


def _corrected(places: _Places, m: Floats, u: Floats, quadratic: bool, comm: Any) -> Floats:
    """Gradient that is exact for linear fields and, if asked for, nearly exact for quadratic ones.

    The average at a node belongs to the centre of mass of its atoms, which is at a distance c_i
    from the node. For a linear field ``u = G xi`` the average therefore gives ``G A`` with
    ``A = 1 + sum_i c_i grad S_ia``, which is multiplied by the inverse of A. For a quadratic field
    there is one more term: the second derivatives times a lever T that follows from the second
    moments at the nodes. T is zero inside a body and about half a cell at its surface. The second
    derivatives are taken from the gradient itself.
    """
    n, d = places.cells.shape
    columns = 1 + d + (d * d if quadratic else 0)
    moments = np.zeros((math.prod(places.window.shape), columns))
    _sum_moments(places, m, moments)
    moments = _over_mass(moments, comm)
    A = np.empty((n, d, d))
    _gradient_at_atoms(places, moments, d, A)
    A += np.eye(d)
    poor = np.linalg.svd(A, compute_uv=False)[:, -1] < LEAST_SPREAD
    A[poor] = np.eye(d)
    inverse = np.linalg.inv(A)

    first = gradient = _slope(places, m, u, comm) @ inverse
    if quadratic:
        T = np.empty((n, d, d, d))
        _levers(places, moments, T)
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
    """Sum over the ranks, then divide by the first column; zero where there is no mass."""
    if comm is not None and comm.size > 1:
        from mpi4py import MPI

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
        message = "an atom has a position that is not finite (nan or inf)"
        raise InputError("atomic strain", [Problem("x", None, message, hint)])
    if np.prod(shape) > MAX_NODES:
        hint = "raise it, or leave atoms that have flown away out of the dump"
        nodes = " x ".join(f"{n:.0f}" for n in shape)
        raise InputError(
            "atomic strain",
            [Problem("cell", options.cell, f"the atoms spread over {nodes} nodes", hint)],
        )
    shape_ = tuple(int(n) for n in shape)
    window = Window(
        first=tuple(int(n) for n in first),
        shape=shape_,
        period=tuple(n if p else 0 for n, p in zip(shape_, box.periodic, strict=True)),
    )
    return _Grid(box.origin, edges, window)


def _extent(comm: Any, cells: Floats) -> tuple[Floats, Floats]:
    """Smallest and largest coordinates of the atoms of all ranks."""
    d = cells.shape[1]
    low = cells.min(axis=0, initial=np.inf) if len(cells) else np.full(d, np.inf)
    high = cells.max(axis=0, initial=-np.inf) if len(cells) else np.full(d, -np.inf)
    low, high = np.nan_to_num(low, nan=-np.inf), np.nan_to_num(high, nan=np.inf, posinf=np.inf)
    if comm is not None:
        from mpi4py import MPI

        comm.Allreduce(MPI.IN_PLACE, low, op=MPI.MIN)
        comm.Allreduce(MPI.IN_PLACE, high, op=MPI.MAX)
    return low, high


@njit(cache=True)
def _sum_field(places: _Places, m: Floats, field: Floats, sums: Floats) -> None:
    """P2G: add to each node the mass ``sum S m``, and ``sum S m f``."""
    t, half, window = places
    count, columns = 3 ** len(window.shape), field.shape[1]
    nodes, S, value = np.empty(count, np.int64), np.empty(count), np.empty(1 + columns)
    for a in range(t.shape[0]):
        gimp_stencil(t[a], half, window, nodes, S)
        value[0] = m[a]
        for k in range(columns):
            value[1 + k] = m[a] * field[a, k]
        scatter(nodes, S, value, sums, count, 1 + columns)


@njit(cache=True)
def _sum_moments(places: _Places, m: Floats, sums: Floats) -> None:
    """Add the mass and its first moments about the node, and the second ones if there is room."""
    t, half, window = places
    d = len(window.shape)
    count, second = 3**d, sums.shape[1] > 1 + d
    nodes, S, away = np.empty(count, np.int64), np.empty(count), np.empty((count, d))
    for a in range(t.shape[0]):
        gimp_stencil(t[a], half, window, nodes, S)
        gimp_offsets(t[a], half, window, away)
        for i in range(count):
            node, mass = nodes[i], S[i] * m[a]
            sums[node, 0] += mass
            for k in range(d):
                sums[node, 1 + k] += mass * away[i, k]
                if second:
                    for j in range(d):
                        sums[node, 1 + d * (1 + k) + j] += mass * away[i, k] * away[i, j]


@njit(cache=True)
def _gradient_at_atoms(places: _Places, nodal: Floats, columns: int, slope: Floats) -> None:
    """G2P: ``sum_i f_i grad S_ia`` for the first columns of a nodal field."""
    t, half, window = places
    d = len(window.shape)
    count = 3**d
    nodes, S, dS = np.empty(count, np.int64), np.empty(count), np.empty((count, d))
    for a in range(t.shape[0]):
        gimp_stencil(t[a], half, window, nodes, S)
        gimp_gradients(t[a], half, window, 1.0, dS)
        gather_gradient(nodes, dS, nodal, slope[a], count, columns)


@njit(cache=True)
def _levers(places: _Places, moments: Floats, T: Floats) -> None:
    """``sum_i <(xi - xi_a)_k (xi - xi_a)_l>_i grad_j S_ia / 2`` with averages over nodes' atoms."""
    t, half, window = places
    d = len(window.shape)
    count = 3**d
    nodes, S = np.empty(count, np.int64), np.empty(count)
    dS, away = np.empty((count, d)), np.empty((count, d))
    for a in range(t.shape[0]):
        gimp_stencil(t[a], half, window, nodes, S)
        gimp_gradients(t[a], half, window, 1.0, dS)
        gimp_offsets(t[a], half, window, away)
        T[a] = 0.0
        for i in range(count):
            average = moments[nodes[i]]
            for k in range(d):
                for l in range(d):  # noqa: E741
                    about = average[d * (1 + k) + l] + away[i, k] * away[i, l]
                    about -= average[k] * away[i, l] + average[l] * away[i, k]
                    for j in range(d):
                        T[a, k, l, j] += 0.5 * about * dS[i, j]

"""From atoms to nodes and back: lumped and consistent projection (paper section 3.1).

Atoms carry the uGIMP weights of the background grid (paper Eq. 14); the half-width of an atom is
half the spacing of the lattice. Weights are computed once per coupling step and serve all passes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit

from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid import PAD, BackgroundGrid, Floats, Ints
from gimpmd_schemas.interpolation import stencil

ITERATIONS = 3
"""Corrections of the consistent projection; fewer leave the coupling unstable."""


@dataclass(frozen=True)
class Weights:
    """Nodes that atoms touch, shape ``(n, 9)``, and the weights ``S_ia`` of the same shape.

    Nodes are numbered by their place in the patch's list of nodes.
    """

    nodes: Ints
    S: Floats


class NodeMap:
    """The nodes of a patch, as atoms of one spacing see them.

    Parameters
    ----------
    grid : BackgroundGrid
    nodes : ndarray of int64
        Ids of the canonical nodes of the patch, ascending.
    spacing : float
        Distance of atoms, ``sqrt(area per atom)``; at most one cell.
    """

    def __init__(self, grid: BackgroundGrid, nodes: Ints, spacing: float) -> None:
        self._cell = grid.cell
        self._half_width = 0.5 * spacing / grid.cell
        self._origin = np.array(grid.origin)
        self._period = np.where(grid.periodic, grid.cells, 0).astype(np.float64)
        place = np.full(grid.size, -1, dtype=np.int64)
        place[nodes] = np.arange(nodes.size)
        self._place = place[grid.images()].reshape(grid.shape)

    def weights(self, x: Floats) -> Weights:
        """Weights of atoms at ``x``, shape ``(n, 2)``.

        Raises
        ------
        BackendError
            An atom touches a node that is none of the patch's.
        """
        nodes = np.empty((x.shape[0], 9), dtype=np.int64)
        S = np.empty((x.shape[0], 9))
        cells = (x - self._origin) / self._cell
        stray = _weigh(cells, self._half_width, self._period, self._place, nodes, S)
        if stray >= 0:
            raise BackendError(
                f"an atom at ({x[stray, 0]:g}, {x[stray, 1]:g}) has left the background grid or "
                "lies too far outside its patch: the body has moved too far, the run is unstable "
                "(see the temperature in log.lammps), or the LAMMPS script changes the processor "
                "grid (processors, balance)"
            )
        return Weights(nodes, S)


def interpolate(weights: Weights, field: Floats) -> Floats:
    """Nodal field at the atoms, ``sum_i S_ia V_i``, shape ``(n, 2)``."""
    values = np.empty((weights.nodes.shape[0], 2))
    _gather(weights.nodes, weights.S, field, values)
    return values


def project(
    weights: Weights, m: Floats, q: Floats, size: int, complete: Callable[[Floats], None]
) -> tuple[Floats, Floats, Floats]:
    """Nodal mass, momentum and velocity of atoms with masses m and velocities q.

    The lumped velocity ``V_i = sum_a S_ia m_a q_a / M_i`` (paper section 3.1) is corrected by
    the projection of what it leaves at the atoms, ``q_a - sum_i S_ia V_i``; this tends to the
    velocity whose interpolation fits the atoms best (consistent mass matrix).

    Parameters
    ----------
    weights : Weights
    m : ndarray, shape ``(n,)``
    q : ndarray, shape ``(n, 2)``
    size : int
        Number of nodes of the patch.
    complete : callable
        Completes nodal sums, shape ``(size, k)``, over the patches, in place.

    Returns
    -------
    mass : ndarray, shape ``(size,)``
    momentum, velocity : ndarray, shape ``(size, 2)``
        The momentum is the plain sum ``sum_a S_ia m_a q_a``, so that its total is exact.
    """
    sums = np.zeros((size, 3))
    _scatter(weights.nodes, weights.S, m, q, sums)
    complete(sums)
    mass, momentum = sums[:, 0].copy(), sums[:, 1:].copy()
    inverse = np.divide(1.0, mass, out=np.zeros(size), where=mass > 0.0)[:, None]
    velocity = momentum * inverse
    for _ in range(ITERATIONS):
        rest = np.zeros((size, 2))
        _scatter_rest(weights.nodes, weights.S, m, q, velocity, rest)
        complete(rest)
        velocity += rest * inverse
    return mass, momentum, velocity


@njit(cache=True)
def _weigh(
    cells: Floats, half_width: float, period: Floats, place: Ints, nodes: Ints, S: Floats
) -> int:
    """Fill nodes and weights; the index of an atom that touches a strange node, or -1."""
    for a in range(cells.shape[0]):
        x, y = cells[a, 0], cells[a, 1]
        if period[0] > 0.0:
            x -= period[0] * np.floor(x / period[0])
        if period[1] > 0.0:
            y -= period[1] * np.floor(y / period[1])
        i, sx0, sx1, sx2, _, _, _ = stencil(x, half_width)
        j, sy0, sy1, sy2, _, _, _ = stencil(y, half_width)
        i += PAD
        j += PAD
        if not (0 <= i < place.shape[0] - 2 and 0 <= j < place.shape[1] - 2):
            return a
        for k, sx in enumerate((sx0, sx1, sx2)):
            for n, sy in enumerate((sy0, sy1, sy2)):
                node = place[i + k, j + n]
                if node < 0:
                    return a
                nodes[a, 3 * k + n] = node
                S[a, 3 * k + n] = sx * sy
    return -1


@njit(cache=True)
def _scatter(nodes: Ints, S: Floats, m: Floats, q: Floats, sums: Floats) -> None:
    for a in range(nodes.shape[0]):
        px, py = m[a] * q[a, 0], m[a] * q[a, 1]
        for k in range(9):
            i, s = nodes[a, k], S[a, k]
            sums[i, 0] += s * m[a]
            sums[i, 1] += s * px
            sums[i, 2] += s * py


@njit(cache=True)
def _scatter_rest(
    nodes: Ints, S: Floats, m: Floats, q: Floats, velocity: Floats, rest: Floats
) -> None:
    for a in range(nodes.shape[0]):
        rx, ry = q[a, 0], q[a, 1]
        for k in range(9):
            i, s = nodes[a, k], S[a, k]
            rx -= s * velocity[i, 0]
            ry -= s * velocity[i, 1]
        for k in range(9):
            i, s = nodes[a, k], S[a, k]
            rest[i, 0] += s * m[a] * rx
            rest[i, 1] += s * m[a] * ry


@njit(cache=True)
def _gather(nodes: Ints, S: Floats, field: Floats, values: Floats) -> None:
    for a in range(nodes.shape[0]):
        vx, vy = 0.0, 0.0
        for k in range(9):
            i, s = nodes[a, k], S[a, k]
            vx += s * field[i, 0]
            vy += s * field[i, 1]
        values[a, 0] = vx
        values[a, 1] = vy

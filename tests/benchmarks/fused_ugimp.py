"""A step of uGIMP with nothing but its arithmetic: the yardstick of ``bench_gimp.py``.

USL in two dimensions for a linear law, four points to a cell, one thread, float64: two sweeps by
hand, weights worked out in each, mass, momentum and force scattered together. It knows no levels,
ranks, cracks, other interpolations, laws or integrators, so a solver that is as fast wastes nothing
on them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit

from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.grid.interpolation import stencil

LAME = SHEAR = 1.0 / 3.0


@njit(cache=True, fastmath={"contract"})
def _clear(nodes: Floats) -> None:
    nodes[:] = 0.0


@njit(cache=True, fastmath={"contract"})
def _to_nodes(points: Floats, nodes: Floats, per_cell: float, mass: float) -> None:
    for p in range(points.shape[0]):
        x, y, u, v, xx, yy, xy = points[p]
        i, a0, a1, a2, d0, d1, d2 = stencil(x * per_cell, 0.25)
        j, b0, b1, b2, e0, e1, e2 = stencil(y * per_cell, 0.25)
        V = -mass * per_cell  # density one
        for n in range(3):
            a, d = ((a0, d0), (a1, d1), (a2, d2))[n]
            row = nodes[i + n]
            for k in range(3):
                b, e = ((b0, e0), (b1, e1), (b2, e2))[k]
                m = mass * a * b
                row[j + k, 0] += m
                row[j + k, 1] += m * u
                row[j + k, 2] += m * v
                row[j + k, 3] += V * (xx * d * b + xy * a * e)
                row[j + k, 4] += V * (xy * d * b + yy * a * e)


@njit(cache=True, fastmath={"contract"})
def _solve(nodes: Floats, dt: float) -> None:
    for i in range(nodes.shape[0]):
        for j in range(nodes.shape[1]):
            if nodes[i, j, 0] > 1e-14:
                inverse = 1.0 / nodes[i, j, 0]
                for k in range(1, 3):
                    nodes[i, j, 2 + k] *= inverse
                    nodes[i, j, k] = nodes[i, j, k] * inverse + dt * nodes[i, j, 2 + k]


@njit(cache=True, fastmath={"contract"})
def _to_points(points: Floats, nodes: Floats, per_cell: float, dt: float) -> None:
    for p in range(points.shape[0]):
        i, a0, a1, a2, d0, d1, d2 = stencil(points[p, 0] * per_cell, 0.25)
        j, b0, b1, b2, e0, e1, e2 = stencil(points[p, 1] * per_cell, 0.25)
        u = v = du = dv = ux = uy = vx = vy = 0.0
        for n in range(3):
            a, d = ((a0, d0), (a1, d1), (a2, d2))[n]
            row = nodes[i + n]
            along_u = b0 * row[j, 1] + b1 * row[j + 1, 1] + b2 * row[j + 2, 1]
            along_v = b0 * row[j, 2] + b1 * row[j + 1, 2] + b2 * row[j + 2, 2]
            u += a * along_u
            v += a * along_v
            ux += d * along_u
            vx += d * along_v
            uy += a * (e0 * row[j, 1] + e1 * row[j + 1, 1] + e2 * row[j + 2, 1])
            vy += a * (e0 * row[j, 2] + e1 * row[j + 1, 2] + e2 * row[j + 2, 2])
            du += a * (b0 * row[j, 3] + b1 * row[j + 1, 3] + b2 * row[j + 2, 3])
            dv += a * (b0 * row[j, 4] + b1 * row[j + 1, 4] + b2 * row[j + 2, 4])
        points[p, 0] += dt * u
        points[p, 1] += dt * v
        points[p, 2] += dt * du
        points[p, 3] += dt * dv
        rate = dt * per_cell
        points[p, 4] += rate * ((LAME + 2.0 * SHEAR) * ux + LAME * vy)
        points[p, 5] += rate * ((LAME + 2.0 * SHEAR) * vy + LAME * ux)
        points[p, 6] += rate * SHEAR * (uy + vx)


def make_step(cells: int) -> Callable[[], None]:
    """A square of ``cells`` by ``cells`` cells with a smooth velocity; returns one step of it."""
    h = 1.0 / cells
    axis = (np.arange(2 * cells) + 0.5) / 2 + 2
    lattice = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    nearest = np.floor(lattice + 0.5)
    lattice = lattice[np.lexsort((nearest[:, 1], nearest[:, 0]))]
    points = np.zeros((lattice.shape[0], 7))
    points[:, :2] = lattice * h
    points[:, 2:4] = 0.01 * np.sin(2.0 * np.pi * lattice * h)
    nodes = np.zeros((cells + 5, cells + 5, 5))

    def step() -> None:
        _clear(nodes)
        _to_nodes(points, nodes, 1.0 / h, 0.25 * h * h)
        _solve(nodes, 0.1 * h)
        _to_points(points, nodes, 1.0 / h, 0.1 * h)

    return step

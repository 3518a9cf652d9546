"""The fit of the absorber by its definition, with a full matrix."""

from __future__ import annotations

from itertools import product

import numpy as np

from gimpmd_md.coupling.spline_fit import CORRECTIONS, LEAST_MASS, SPACING
from gimpmd_schemas.grid.background import BackgroundGrid


def b3(t: np.ndarray) -> np.ndarray:
    """The cubic B-spline."""
    t = np.abs(t)
    return np.where(t < 1, 2 / 3 - t**2 + t**3 / 2, np.clip(2 - t, 0, None) ** 3 / 6)


def rest(grid: BackgroundGrid, x: np.ndarray, m: np.ndarray) -> np.ndarray:
    """R of particles in a body that repeats along no axis, shape ``(n, n)``."""
    return family(grid, x, m, 0.5) @ family(grid, x, m, 0.0)


def family(grid: BackgroundGrid, x: np.ndarray, m: np.ndarray, shift: float) -> np.ndarray:
    """``(1 - N W)^3`` of one family of splines."""
    spacing = SPACING * grid.cell
    counts = [int(np.ceil(n / SPACING)) + 6 for n in grid.cells]
    index = np.array(list(product(*map(range, counts)))) - 3.0 + shift
    X = np.array(grid.origin) + spacing * index
    N = b3((x[:, None] - X) / spacing).prod(axis=2)
    X, N = X[N.any(axis=0)], N[:, N.any(axis=0)]
    reach = m @ N
    enough = reach >= LEAST_MASS * reach.max()
    W = np.empty((len(X), len(x)))
    for j, place in enumerate(X):
        away = np.linalg.norm(X[enough] - place, axis=1)
        functions = []
        for near in np.flatnonzero(away < away.min() + 1e-9 * spacing):
            w = N[:, enough][:, near] * m
            linear = np.column_stack([np.ones(len(x)), x - place])
            found = np.linalg.solve(linear.T @ (w[:, None] * linear), (w[:, None] * linear).T)
            functions.append(found[0])
        W[j] = np.mean(functions, axis=0)
    return np.linalg.matrix_power(np.eye(len(x)) - N @ W, CORRECTIONS)

"""Weights of GIMP as dense matrices, from their definition, and bodies that are small enough.

The weight of a node for a point is the mean of the node's hat function over the domain of the
point (paper Eq. 9). Nothing of the solver is used here.
"""

from __future__ import annotations

import numpy as np

from gimpmd_gimp.points.material_points import MaterialPoints
from gimpmd_gimp.step.solver import Solver


def hat(r: np.ndarray) -> np.ndarray:
    """Linear hat function of a distance in cells."""
    return np.maximum(1.0 - np.abs(r), 0.0)


def _integral(r: np.ndarray) -> np.ndarray:
    """Integral of ``hat`` from -1 to r."""
    r = np.clip(r, -1.0, 1.0)
    return 0.5 + r - 0.5 * np.sign(r) * r**2


def weights(
    x: np.ndarray, half: np.ndarray, nodes: np.ndarray, cell: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Weights ``S (n, N)`` of N nodes for n points, and their gradients ``G (n, N, d)``.

    ``half`` holds the half-widths of the domains in cells, shape ``(n, d)``.
    """
    r, half = (x[:, None] - nodes) / cell, half[:, None]
    S = (_integral(r + half) - _integral(r - half)) / (2.0 * half)
    slope = (hat(r + half) - hat(r - half)) / (2.0 * half * cell)
    G = np.empty_like(S)
    for axis in range(x.shape[1]):
        factors = S.copy()
        factors[:, :, axis] = slope[:, :, axis]
        G[:, :, axis] = factors.prod(axis=2)
    return S.prod(axis=2), G


def weights_of(solver: Solver) -> tuple[np.ndarray, np.ndarray]:
    """Weights of the nodes of a solver with one level, without periodic faces, for its points."""
    p, mesh = solver.points, solver.mesh
    x = p.on_grid(solver.method.configuration)
    return weights(x, p.half, mesh.positions(), mesh.hierarchy.cell)


def hooke(F: np.ndarray, lame: float, shear: float) -> np.ndarray:
    """Stress of Hooke's law at displacement gradients ``F - I``, shape ``(n, d, d)``."""
    strain = 0.5 * (F + F.swapaxes(1, 2)) - np.eye(F.shape[1])
    trace = np.einsum("nkk->n", strain)[:, None, None]
    return lame * trace * np.eye(F.shape[1]) + 2.0 * shear * strain


def disturb(p: MaterialPoints, seed: int = 0) -> None:
    """Random velocities and displacement gradients of a few percent."""
    rng = np.random.default_rng(seed)
    p.v[:] = 0.05 * rng.normal(size=p.v.shape)
    p.F[:] += 0.02 * rng.normal(size=p.F.shape)

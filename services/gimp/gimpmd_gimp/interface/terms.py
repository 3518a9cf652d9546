"""What the interface adds on the continuum's side: an energy of nodal displacements."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import sparse

from gimpmd_gimp.interface.bonds import Bonds, crossing_weights, ghost_weights
from gimpmd_gimp.interface.correction import Correction
from gimpmd_gimp.interface.lattice import Lattice
from gimpmd_gimp.interface.weights import Sparse, gradients
from gimpmd_gimp.laws.law import kernel
from gimpmd_schemas.grid import BackgroundGrid, Bools, Floats, Ints


@dataclass(frozen=True, eq=False)
class Terms:
    """Rods and corrected points, or some of them, and the nodes that they touch.

    A rod is the part of a free-ghost bond in the continuum, which the material points count
    already: ``E = -theta phi(R + (u(ghost) - u(crossing)) / theta)``.

    Attributes
    ----------
    nodes : ndarray of int64, shape ``(n,)``
        Ids on the shared grid; nodal arrays have a row for each.
    rods : Bonds
    points : Correction
    lattice : Lattice
    stretch : sparse matrix, shape ``(rods, n)``
        ``u(ghost) - u(crossing)`` from nodal displacements.
    gradient : pair of sparse matrices, shape ``(points, n)``
        Displacement gradients by x and y of the corrected points.
    """

    nodes: Ints
    rods: Bonds
    points: Correction
    lattice: Lattice
    stretch: Sparse
    gradient: tuple[Sparse, Sparse]

    def take(self, rods: Ints | Bools, points: Ints | Bools) -> Terms:
        """The share of a rank: some rods and some points, on the nodes that these touch."""
        whole = self.stretch[rods], self.gradient[0][points], self.gradient[1][points]
        used = _touched(whole)
        stretch, *gradient = (matrix[:, used] for matrix in whole)
        return replace(
            self,
            nodes=self.nodes[used],
            rods=self.rods.take(rods),
            points=self.points.take(points),
            stretch=stretch,
            gradient=(gradient[0], gradient[1]),
        )

    def energy(self, U: Floats) -> float:
        """Energy, less that at rest, at nodal displacements ``(n, 2)``."""
        rods = _energy(*self._rods(U))
        E = self._strain(self._deformation(U))
        S0, dA = self.points.S0, self.points.dA
        density = (S0 * E).sum(axis=1) + 0.5 * np.einsum("pi,pij,pj->p", E, dA, E)
        return rods + float((self.points.volume * density).sum())

    def force(self, U: Floats) -> Floats:
        """Nodal forces, ``-dE/dU``, shape ``(n, 2)``."""
        q = np.empty((self.rods.count, 2))
        _forces(*self._rods(U), q)
        F = self._deformation(U)
        E = self._strain(F)
        S = self.points.S0 + np.einsum("pij,pj->pi", self.points.dA, E)
        P = F @ S[:, [[0, 2], [2, 1]]] * self.points.volume[:, None, None]
        by_x, by_y = self.gradient
        total: Floats = self.stretch.T @ q - by_x.T @ P[:, :, 0] - by_y.T @ P[:, :, 1]
        return total

    def linear(self) -> LinearTerms:
        """The same for small strains: forces to first order in the displacements."""
        rods, kind = self.rods, self.rods.kind
        q = rods.sign[:, None] * self.lattice.forces(np.eye(2))[kind]
        K = self.lattice.stiffnesses()[kind] / rods.theta[:, None, None]
        S0 = self.points.S0[:, [[0, 2], [2, 1]]]
        A = self._moduli()
        by, V = self.gradient, self.points.volume
        load = self.stretch.T @ q
        for j in range(2):
            load -= by[j].T @ (V[:, None] * S0[:, :, j])
        blocks: list[list[Sparse]] = [[None, None], [None, None]]
        for i in range(2):
            for k in range(2):
                block = self.stretch.T @ sparse.diags_array(K[:, i, k]) @ self.stretch
                for j in range(2):
                    for l in range(2):  # noqa: E741
                        block -= by[j].T @ sparse.diags_array(V * A[:, i, j, k, l]) @ by[l]
                blocks[i][k] = block
        # from all x, then all y, to the rows of nodal arrays
        n = self.nodes.size
        order = np.arange(2 * n).reshape(2, n).T.ravel()
        matrix = sparse.block_array(blocks, format="csr")[order][:, order]
        return LinearTerms(self.nodes, matrix.tocsr(), load)

    def _rods(self, U: Floats) -> tuple[Any, ...]:
        """Rods as the kernels want them: ``u(ghost) - u(crossing)`` first."""
        rods, lattice = self.rods, self.lattice
        arrays = (rods.kind, rods.sign, rods.theta, lattice.bonds, lattice.energy)
        return (np.ascontiguousarray(self.stretch @ U), *arrays)

    def _deformation(self, U: Floats) -> Floats:
        F = np.stack([by @ U for by in self.gradient], axis=2)
        deformation: Floats = np.eye(2) + F
        return deformation

    @staticmethod
    def _strain(F: Floats) -> Floats:
        """Green-Lagrange strain, Voigt with engineering shear."""
        C = np.einsum("pki,pkj->pij", F, F)
        return np.stack([0.5 * (C[:, 0, 0] - 1.0), 0.5 * (C[:, 1, 1] - 1.0), C[:, 0, 1]], axis=1)

    def _moduli(self) -> Floats:
        """``dP_ij / dH_kl`` of the corrected points at rest, shape ``(points, 2, 2, 2, 2)``."""
        voigt = np.array([[0, 2], [2, 1]])
        A = self.points.dA[:, voigt[:, :, None, None], voigt[None, None]]
        S0 = self.points.S0[:, voigt]
        A = A + np.einsum("ik,pjl->pijkl", np.eye(2), S0)
        return A


@dataclass(frozen=True, eq=False)
class LinearTerms:
    """Terms whose forces are linear in nodal displacements.

    Attributes
    ----------
    nodes : ndarray of int64, shape ``(n,)``
    matrix : sparse matrix, shape ``(2 n, 2 n)``
        Symmetric; row ``2 i + d`` is the force on node i along d.
    load : ndarray, shape ``(n, 2)``
        Forces at rest.
    """

    nodes: Ints
    matrix: Sparse
    load: Floats

    def energy(self, U: Floats) -> float:
        """Energy, less that at rest, at nodal displacements ``(n, 2)``."""
        return float(-(self.load * U).sum() - 0.5 * U.ravel() @ (self.matrix @ U.ravel()))

    def force(self, U: Floats) -> Floats:
        """Nodal forces, shape ``(n, 2)``."""
        force: Floats = self.load + (self.matrix @ U.ravel()).reshape(-1, 2)
        return force


def make_terms(rods: Bonds, points: Correction, lattice: Lattice, grid: BackgroundGrid) -> Terms:
    """Terms of rods and corrected points."""
    stretch = ghost_weights(rods, grid) - crossing_weights(rods, lattice, grid)
    by_x, by_y = gradients(grid, points.reference, points.half)
    every = np.arange(grid.size)
    whole = Terms(every, rods, points, lattice, stretch, (by_x, by_y))
    return whole.take(np.arange(rods.count), np.arange(points.count))


def _touched(matrices: tuple[Sparse, ...]) -> Ints:
    """Columns with entries."""
    return np.unique(np.concatenate([matrix.indices for matrix in matrices])).astype(np.int64)


@kernel
def _stretched(u: Floats, theta: float, sign: float, bond: Floats) -> tuple[float, float, float]:
    """Vector ``r`` that a rod stands for, and ``s - 1 = |r|^2 / |R|^2 - 1``.

    By the change of r, so that small strains keep their digits.
    """
    x, y, dx, dy = sign * bond[0], sign * bond[1], u[0] / theta, u[1] / theta
    z = (2.0 * (x * dx + y * dy) + dx * dx + dy * dy) / (x * x + y * y)
    return x + dx, y + dy, z


@kernel
def _energy(
    u: Floats, kind: Ints, sign: Floats, theta: Floats, bonds: Floats, energy: Floats
) -> float:
    """``-sum theta phi``."""
    total = 0.0
    for b in range(kind.size):
        c = energy[kind[b]]
        _, _, z = _stretched(u[b], theta[b], sign[b], bonds[kind[b]])
        phi = 0.0
        for k in range(c.size - 1, -1, -1):
            phi = z * (c[k] + phi)
        total -= theta[b] * phi
    return total


@kernel
def _forces(
    u: Floats,
    kind: Ints,
    sign: Floats,
    theta: Floats,
    bonds: Floats,
    energy: Floats,
    q: Floats,
) -> None:
    """Forces ``d phi / d r`` in the bonds that rods stand for, into ``q``, shape ``(n, 2)``."""
    for b in range(kind.size):
        c, R = energy[kind[b]], bonds[kind[b]]
        x, y, z = _stretched(u[b], theta[b], sign[b], R)
        slope = 0.0
        for k in range(c.size - 1, -1, -1):
            slope = z * slope + (k + 1) * c[k]
        slope *= 2.0 / (R[0] * R[0] + R[1] * R[1])
        q[b, 0], q[b, 1] = slope * x, slope * y

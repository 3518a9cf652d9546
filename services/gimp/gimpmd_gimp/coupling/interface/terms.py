"""What the interface adds on the continuum's side: an energy of nodal displacements."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import sparse

from gimpmd_gimp.coupling.interface.bonds import Bonds, crossing_weights, ghost_weights
from gimpmd_gimp.coupling.interface.correction import Correction
from gimpmd_gimp.coupling.interface.lattice import Lattice
from gimpmd_gimp.coupling.interface.weights import Sparse, gradients
from gimpmd_gimp.laws.law import kernel, squared
from gimpmd_gimp.sweeps.simd import Vector, at, deposit, load, store, zero
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.grid.background import BackgroundGrid

AXES = (0, 0)

LANES = 64
"""Rods that are worked on side by side."""

Parts = tuple[Ints, Ints, Floats]
"""Starts of rows, columns and weights of a sparse matrix."""


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
        """The part of a rank: some rods and some points, on the nodes that these touch."""
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
        return self.evaluate(U)[0]

    def force(self, U: Floats) -> Floats:
        """Nodal forces, ``-dE/dU``, shape ``(n, 2)``."""
        return self.evaluate(U)[1]

    def evaluate(self, U: Floats) -> tuple[float, Floats]:
        """Energy and nodal forces in one sweep, as the finite laws have them."""
        force, rods, points = np.zeros((self.nodes.size, 2)), self.rods, self.points
        pull = np.empty((rods.count, 2))
        stretch, bonds = _parts(self.stretch), (self.lattice.bonds, self.lattice.energy)
        arrays = (rods.kind, rods.sign, rods.theta, *bonds)
        energy = _sum_rods(stretch, self._runs, *arrays, U, pull)
        _sum_at_nodes(_parts(self._at_nodes), pull, force)
        x, y = (_parts(matrix) for matrix in self.gradient)
        energy += _sum_points(x, y, points.volume, points.S0, points.dA, U, force)
        return energy, force

    @cached_property
    def _runs(self) -> Ints:
        """Where runs of rods of one kind begin, and where the last one ends."""
        kind = self.rods.kind
        return np.append(np.flatnonzero(np.diff(kind, prepend=-1)), kind.size)

    @cached_property
    def _at_nodes(self) -> Sparse:
        """The rods of every node and their weights."""
        return self.stretch.T.tocsr()

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
        return self.evaluate(U)[0]

    def force(self, U: Floats) -> Floats:
        """Nodal forces, shape ``(n, 2)``."""
        return self.evaluate(U)[1]

    def evaluate(self, U: Floats) -> tuple[float, Floats]:
        """Energy and nodal forces."""
        change = (self.matrix @ U.ravel()).reshape(U.shape)
        return -float(((self.load + 0.5 * change) * U).sum()), self.load + change


def make_terms(rods: Bonds, points: Correction, lattice: Lattice, grid: BackgroundGrid) -> Terms:
    """Terms of rods and corrected points."""
    stretch = ghost_weights(rods, grid) - crossing_weights(rods, lattice, grid)
    by_x, by_y = gradients(grid, points.reference, points.half)
    every = np.arange(grid.size)
    whole = Terms(every, rods, points, lattice, stretch, (by_x, by_y))
    return whole.take(np.arange(rods.count), np.arange(points.count))


@kernel
def _gather(matrix: Parts, row: int, U: Floats) -> Vector:
    start, column, weight = matrix
    total = zero(AXES)
    for k in range(at(start, row), at(start, row + 1)):
        total = total + at(weight, k) * load(AXES, U, np.int64(at(column, k)))
    return total


@kernel
def _scatter(matrix: Parts, row: int, q: Vector, force: Floats) -> None:
    start, column, weight = matrix
    for k in range(at(start, row), at(start, row + 1)):
        deposit(force, np.int64(at(column, k)), at(weight, k) * q)


@kernel
def _sum_at_nodes(at_nodes: Parts, pull: Floats, force: Floats) -> None:
    """Add the forces of the rods at the nodes.

    Each node is written once. Rods that would write to it one after another would have to wait.
    """
    for i in range(force.shape[0]):
        deposit(force, i, _gather(at_nodes, i, pull))


@kernel
def _sum_rods(
    stretch: Parts,
    runs: Ints,
    kind: Ints,
    sign: Floats,
    theta: Floats,
    bonds: Floats,
    energy: Floats,
    U: Floats,
    pull: Floats,
) -> float:
    """Energy of the rods; writes their forces ``2 phi'(s) r / |R|^2`` to ``pull (rods, 2)``.

    Rods of one kind go side by side, so that the processor's vector units are used.
    """
    total = 0.0
    r, (z, phi, slope) = np.zeros((LANES, 2)), np.zeros((3, LANES))
    for run in range(runs.size - 1):
        m = kind[runs[run]]
        over_square = 1.0 / (squared(bonds[m, 0]) + squared(bonds[m, 1]))
        for first in range(runs[run], runs[run + 1], LANES):
            count = min(LANES, runs[run + 1] - first)
            for lane in range(count):
                b = first + lane
                u = 1.0 / theta[b] * _gather(stretch, b, U)
                r[lane, 0] = sign[b] * bonds[m, 0] + u[0]
                r[lane, 1] = sign[b] * bonds[m, 1] + u[1]
                z[lane] = over_square * (squared(r[lane, 0]) + squared(r[lane, 1])) - 1.0
            phi[:], slope[:] = 0.0, 0.0
            for k in range(energy.shape[1] - 1, -1, -1):
                c = energy[m, k]
                for lane in range(LANES):
                    slope[lane] = z[lane] * slope[lane] + (k + 1) * c
                    phi[lane] = z[lane] * (phi[lane] + c)
            for lane in range(count):
                total -= theta[first + lane] * phi[lane]
                q = 2.0 * over_square * slope[lane] * load(AXES, r, lane)
                store(pull, first + lane, q)
    return total


@kernel
def _sum_points(
    by_x: Parts, by_y: Parts, volume: Floats, S0: Floats, dA: Floats, U: Floats, force: Floats
) -> float:
    """Energy of the corrections; adds their forces, ``-V P grad S``, ``P = F (S0 + dA : E)``."""
    total, P = 0.0, np.zeros((2, 2))  # P holds the columns of the stress
    for p in range(volume.size):
        x, y = _gather(by_x, p, U), _gather(by_y, p, U)
        xx, yx, xy, yy = x[0] + 1.0, x[1], y[0], y[1] + 1.0
        E = 0.5 * (xx * xx + yx * yx - 1.0), 0.5 * (xy * xy + yy * yy - 1.0), xx * xy + yx * yy
        a = dA[p, 0, 0] * E[0] + dA[p, 0, 1] * E[1] + dA[p, 0, 2] * E[2]
        b = dA[p, 1, 0] * E[0] + dA[p, 1, 1] * E[1] + dA[p, 1, 2] * E[2]
        c = dA[p, 2, 0] * E[0] + dA[p, 2, 1] * E[1] + dA[p, 2, 2] * E[2]
        V, S = volume[p], S0[p]
        total += V * ((S[0] + 0.5 * a) * E[0] + (S[1] + 0.5 * b) * E[1] + (S[2] + 0.5 * c) * E[2])
        a, b, c = S[0] + a, S[1] + b, S[2] + c
        P[0, 0], P[0, 1] = xx * a + xy * c, yx * a + yy * c
        P[1, 0], P[1, 1] = xx * c + xy * b, yx * c + yy * b
        _scatter(by_x, p, -V * load(AXES, P, 0), force)
        _scatter(by_y, p, -V * load(AXES, P, 1), force)
    return total


def _parts(matrix: Sparse) -> Parts:
    return matrix.indptr, matrix.indices, matrix.data


def _touched(matrices: tuple[Sparse, ...]) -> Ints:
    """Columns with entries."""
    return np.unique(np.concatenate([matrix.indices for matrix in matrices])).astype(np.int64)

"""Dispersion correction: the inertia of the grid, exact to one more order of the wavelength.

Lumped masses and the projection of velocities slow waves down. At the wave number k the phase speed
is ``c (1 - (d / 2 + 1 / 24) (k h)^2 + ...)``, with ``d = 1 / 6 + l^2 / 3`` for points of half-width
l cells. The correction ``Q = I + beta (I - Pi)``, with the
projection ``Pi = M^-1 S^T m S`` of nodal velocities to points and back, acts on accelerations and
on projected velocities; ``beta = (1 + 1 / (12 d)) / 2`` cancels the term. It is a symmetric change
of the mass matrix, ``M (Q Pi Q)^-1`` in place of ``M Pi^-1``: energy, momentum and uniform fields
stay exact.

``M (I - Pi)`` is the Laplacian of a graph: nodes that share points exchange momentum along edges,
whose weights are the entries of the consistent mass. Edges may be left out, and the others keep all
these properties. Left out are nodes in contact across a crack and nodes with dashpots.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from scipy.sparse import csr_array, diags_array

from gimpmd_gimp.boundary.condition import Condition
from gimpmd_gimp.grid import subcycling
from gimpmd_gimp.grid.constraints import Constraints
from gimpmd_gimp.grid.nodes import Nodes
from gimpmd_gimp.points.body import Body
from gimpmd_gimp.sweeps.kernels import Stencils, sweep
from gimpmd_gimp.sweeps.simd import at, deposit, load, store, zero
from gimpmd_schemas.arrays import Bools, Floats, Int32s, Ints

CHUNK = 100_000
"""Number of points whose nodes and weights are assembled at a time."""


def correction(half: float) -> float:
    """Strength beta that cancels the leading dispersion, in any number of dimensions.

    Parameters
    ----------
    half : float
        Half-width of a point in cells. Points tile the cells.
    """
    d = 1.0 / 6.0 + half**2 / 3.0
    return 0.5 * (1.0 + 1.0 / (12.0 * d))


def consistent_mass(s: Stencils, constraints: Constraints, mass: Floats, size: int) -> csr_array:
    """Matrix ``C_ij = sum_p S_ip m_p S_jp`` of the composite basis: the part of these points."""
    free = np.ones(size, dtype=np.bool_)
    free[constraints.node] = False
    own = np.flatnonzero(free)
    constrained = np.repeat(constraints.node, np.diff(constraints.start))
    rows, columns = np.concatenate([own, constrained]), np.concatenate([own, constraints.parent])
    weights = np.concatenate([np.ones(own.size), constraints.weight])
    T = csr_array((weights, (rows, columns)), shape=(size, size))
    total = csr_array((size, size))
    for first in range(0, mass.size, CHUNK):
        chosen = np.arange(first, min(first + CHUNK, mass.size))
        S = _weights(s, chosen, size) @ T
        total = total + S.T @ diags_array(mass[chosen]) @ S
    return csr_array(total)


def _weights(s: Stencils, chosen: Ints, size: int) -> csr_array:
    """Weights of some points, one row for each."""
    d, ends = len(s.axes), s.w[chosen]
    w = np.stack([ends[:, 0], 1.0 - ends[:, 0] - ends[:, 1], ends[:, 1]], axis=1)
    nodes, weights = [], []
    for steps in product(range(3), repeat=d):
        nodes.append(s.base[chosen] + s.strides[s.block[chosen]] @ np.array(steps, dtype=np.int64))
        weights.append(np.prod([w[:, k, axis] for axis, k in enumerate(steps)], axis=0))
    node = np.stack(nodes, axis=1)
    cut = s.base[chosen] < 0
    node[cut] = s.detour[-1 - s.base[chosen[cut]]]
    starts = np.arange(0, node.size + 1, 3**d)
    S = csr_array(
        (np.stack(weights, axis=1).ravel(), node.ravel(), starts), shape=(chosen.size, size)
    )
    S.eliminate_zeros()
    return S


class Dispersion:
    """The correction on one rank.

    Parameters
    ----------
    beta : float
        Strength.
    linked : ndarray of bool, shape ``(size,)``
        Nodes with edges, the same on all ranks.
    nodes : Nodes
        With complete nodal masses.
    C : csr_array, shape ``(size, size)``
        Consistent mass of this rank's points.
    """

    def __init__(self, beta: float, linked: Bools, nodes: Nodes, C: csr_array) -> None:
        mesh = nodes.mesh
        self._node = np.flatnonzero(linked)
        C = csr_array(C[self._node][:, self._node])
        C.sort_indices()
        self._matrix = C.indptr.astype(np.int64), C.indices.astype(np.int32), C.data
        weight = np.zeros((mesh.size, 1))
        weight[self._node, 0] = C.sum(axis=1)
        nodes.active[0].halo.complete(weight)
        self._scale = beta / nodes.M[self._node]
        self._weight = weight[self._node, 0] * self._scale

        d = mesh.hierarchy.dim
        self._carried = np.zeros((mesh.size, d))
        # sub-steps of finer levels leave other nodes with the values of their own last step
        self._change, self._velocity = (np.zeros((self._node.size, d)) for _ in range(2))
        self._moving = [
            np.flatnonzero(np.isin(self._node, active.solved)) for active in nodes.active
        ]
        self._kicked = [
            rows[subcycling.kicked_nodes(mesh, level)[self._node[rows]]]
            for level, rows in enumerate(self._moving)
        ]

    def correct_change(self, coarsest: int, nodes: Nodes, dV: Floats) -> None:
        """``dV <- Q dV`` for the change of the nodal velocity in a kick, in place; collective.

        Parameters
        ----------
        coarsest : int
            The coarsest level that steps.
        nodes : Nodes
        dV : ndarray, shape ``(size, d)``
        """
        self._apply(
            self._moving[coarsest], self._kicked[coarsest], coarsest, nodes, dV, self._change
        )

    def correct_velocity(self, coarsest: int, nodes: Nodes, V: Floats) -> None:
        """``V <- Q V`` for a projected nodal velocity; see ``correct_change``."""
        rows = self._moving[coarsest]
        self._apply(rows, rows, coarsest, nodes, V, self._velocity)

    def _apply(
        self, known: Ints, rows: Ints, coarsest: int, nodes: Nodes, V: Floats, values: Floats
    ) -> None:
        axes = nodes.axes
        _take(axes, known, self._node, V, values)
        arrays = (self._node, *self._matrix, values, self._carried)
        nodes.team.share(
            lambda first, last: _carry(axes, rows, first, last, *arrays),
            rows.size,
        )
        nodes.active[coarsest].halo.complete(self._carried)
        _exchange(axes, rows, self._node, self._weight, self._scale, self._carried, V)


def make_dispersion(
    beta: float, body: Body, nodes: Nodes, conditions: Sequence[Condition]
) -> Dispersion:
    """Correction of all nodes that the conditions do not leave out; collective."""
    linked = nodes.mesh.basis & (nodes.mass_floor < nodes.M)
    for condition in conditions:
        condition.leave_out(linked)
    mesh = nodes.mesh
    C = consistent_mass(body.stencils, mesh.constraints, body.points.mass, mesh.size)
    return Dispersion(beta, linked, nodes, C)


@sweep
def _take(axes: tuple[int, ...], rows: Ints, node: Ints, V: Floats, values: Floats) -> None:
    """Nodal values, row by row."""
    for k in range(rows.size):
        r = at(rows, k)
        store(values, r, load(axes, V, at(node, r)))


@sweep
def _carry(
    axes: tuple[int, ...],
    rows: Ints,
    first: int,
    last: int,
    node: Ints,
    start: Ints,
    column: Int32s,
    mass: Floats,
    values: Floats,
    carried: Floats,
) -> None:
    """``carried_i = sum_j C_ij V_j``, at the nodes of ``rows[first:last]``."""
    for k in range(first, last):
        r = at(rows, k)
        total = zero(axes)
        for e in range(at(start, r), at(start, r + 1)):
            total = total + at(mass, e) * load(axes, values, np.int64(at(column, e)))
        store(carried, at(node, r), total)


@sweep
def _exchange(
    axes: tuple[int, ...],
    rows: Ints,
    node: Ints,
    weight: Floats,
    scale: Floats,
    carried: Floats,
    V: Floats,
) -> None:
    """``V_i += beta sum_j C_ij (V_i - V_j) / M_i``."""
    for k in range(rows.size):
        r = at(rows, k)
        i = at(node, r)
        deposit(V, i, at(weight, r) * load(axes, V, i) - at(scale, r) * load(axes, carried, i))

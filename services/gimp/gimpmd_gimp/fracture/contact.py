"""Contact of crack faces: Coulomb friction between the two velocity fields of a node.

A closed pair of nodes moves as one along the crack's normal, and in all directions where it
sticks: velocities and impulses are shared by mass, so that the pair's momentum is exact and a crack
that stays closed and sticks is not there at all. A pair is closed while its faces would overlap by
the end of the step, and the impulse that shares its motion presses (Bardenhagen et al., CMES 2
(2001) 509); where faces are is told by displacements (Nairn, CMES 92 (2013) 271). Displacement
and velocity of a point count as its own gradient continues them to the face, so neither a strain
nor its rate looks like a gap or a closing speed.

A pair slides when sticking would take more than ``friction`` times the normal impulse. Then the
fields exchange just that much, against the sliding, and its work is lost to the body.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gimpmd_gimp.fracture.cracks import Cracks
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.points.material_points import Flags, MaterialPoints
from gimpmd_gimp.sweeps import kernels
from gimpmd_schemas.arrays import Floats, Ints

if TYPE_CHECKING:
    from gimpmd_gimp.step.solver import Solver

OPEN, SLIDING, STICKING = 0, 1, 2
"""States of a pair."""

REACH = 4.5
"""Cells from a crack within which points touch its pairs of nodes."""


class Contact:
    """Pairs of nodes along cracks.

    Parameters
    ----------
    mesh : Mesh
        With twins.
    cracks : Cracks
    friction : float
        Coulomb's coefficient.
    active : sequence of ndarray of int64
        For each level, the nodes that are solved when it is the coarsest that steps.

    Attributes
    ----------
    upper, lower : ndarray of int64, shape ``(n,)``
        Node above and below the crack.
    state : ndarray of int32, shape ``(n,)``
        ``OPEN``, ``SLIDING`` or ``STICKING``, since the last kick.
    friction_work : float
        Energy that friction has taken so far, on this rank's own nodes.
    """

    def __init__(self, mesh: Mesh, cracks: Cracks, friction: float, active: list[Ints]) -> None:
        self._mesh, self._cracks, self._friction = mesh, cracks, friction
        node = np.flatnonzero((mesh.twin >= 0) & mesh.basis)
        x = mesh.positions()[node]
        crack = cracks.nearest(x)
        above = cracks.height(crack, x) >= -1e-9 * mesh.hierarchy.cell
        self._normal = cracks.normal[crack]
        self.upper = np.where(above, node, mesh.twin[node])
        self.lower = np.where(above, mesh.twin[node], node)
        self.state: Flags = np.zeros(node.size, dtype=np.int32)
        self.friction_work = 0.0
        self._finest = mesh.level[node].copy()  # of the levels that push a pair
        for level in range(mesh.hierarchy.top):
            away = mesh.hierarchy.distance(level + 1, x)
            by_finer = (mesh.level[node] == level) & (away < 2.0 * mesh.hierarchy.edge(level))
            self._finest[by_finer] = level + 1
        self._rows = [np.flatnonzero(np.isin(node, nodes)) for nodes in active]
        d = mesh.hierarchy.dim
        self._displacement, self._velocity = np.zeros((mesh.size, d)), np.zeros((mesh.size, d))
        self._next = self.state.copy()

    def regroup(self, points: MaterialPoints) -> None:
        """Find the points near cracks anew, and their heights above them."""
        reach = np.asarray(REACH * self._mesh.hierarchy.cell / 2.0**points.level, dtype=np.float64)
        self._near = np.flatnonzero(self._cracks.near(points.reference, reach))
        X = points.reference[self._near]
        crack = self._cracks.nearest(X)
        self._to_face = -self._cracks.height(crack, X)[:, None] * self._cracks.normal[crack]

    def share(self, V: Floats, M: Floats, level: int) -> None:
        """Give closed pairs one nodal velocity, as far as their state says, in place."""
        rows = self._rows[level]
        self._share(rows, self.state[rows], V, M)

    def act(self, solver: Solver, level: int, finest: int, span: float, U: Floats) -> None:
        """Let pairs exchange impulses: change ``U``, the change of nodal velocity, in place.

        States change, and work counts, with ``commit``. Pairs that finer levels push as well
        keep their state.

        Parameters
        ----------
        level : int
            The coarsest level that steps.
        finest : int
            The finest level whose forces are in ``U``.
        span : float
            Time over which faces that meet count as touching already.
        """
        self._face_fields(solver, level)
        self._next = self.state.copy()
        rows, M = self._rows[level], solver.M
        both = (M[self.upper[rows]] > solver.mass_floor) & (M[self.lower[rows]] > solver.mass_floor)
        self._next[rows[~both]] = OPEN
        rows = rows[both]
        a, b, n = self.upper[rows], self.lower[rows], self._normal[rows]
        reduced = (M[a] * M[b] / (M[a] + M[b]))[:, None]
        closing = self._velocity[b] - self._velocity[a]
        along = _dot(U[b] - U[a], n)
        gap = _dot(self._displacement[a] - self._displacement[b], n)
        speed = along + _dot(closing, n)
        closed = (speed > 0.0) & (gap <= span * speed)

        # what it takes to stick, against what the normal impulse allows
        sliding = closing + U[b] - U[a]
        sliding -= _dot(sliding, n)[:, None] * n
        demand = np.linalg.norm(sliding, axis=1)
        limit = self._friction * np.maximum(along, 0.0)
        sticks = (demand <= limit) & (self._friction > 0.0)
        found = np.where(closed, np.where(sticks, STICKING, SLIDING), OPEN)
        self._next[rows] = np.where(self._finest[rows] <= finest, found, self.state[rows])
        self._share(rows, self._next[rows], U, M)

        slides = (self._next[rows] == SLIDING) & (demand > 0.0)
        share = np.where(slides, limit / np.where(slides, demand, 1.0), 0.0)
        impulse = reduced * share[:, None] * sliding
        U[a] += impulse / M[a, None]
        U[b] -= impulse / M[b, None]
        self._rubbing = (a, b, self._mesh.counts[a, None] * impulse)
        self._before = solver.V[a] - solver.V[b]

    def commit(self, P: Floats, M: Floats) -> None:
        """Accept what ``act`` found, with the momentum of the nodes after the kick.

        Friction's work on the body is its impulse times the mean of the sliding speeds before and
        after: with this the points' energy is balanced exactly.
        """
        self.state[:] = self._next
        a, b, impulse = self._rubbing
        after = P[a] / M[a, None] - P[b] / M[b, None]
        self.friction_work -= 0.5 * float(np.sum(impulse * (self._before + after)))

    def _face_fields(self, solver: Solver, level: int) -> None:
        """Displacement and velocity of the points near cracks at their faces, on the nodes."""
        p, near = solver.points, self._near
        L = solver.velocity_gradient(near)
        F = p.F[near] - np.eye(p.dim)
        u, v = np.zeros_like(p.v), np.zeros_like(p.v)
        u[near] = p.x[near] - p.reference[near] + np.einsum("nij,nj->ni", F, self._to_face)
        v[near] = p.v[near] + np.einsum("nij,nj->ni", L, self._to_face)
        active, axes = solver.active[level], solver.stencils.axes
        for point_field, field in ((u, self._displacement), (v, self._velocity)):
            kernels.clear(axes, active.cleared, field)
            kernels.scatter_vector(near, 0, near.size, solver.stencils, p.mass, point_field, field)
            active.slaves.restrict(field)
        active.halo.complete(self._displacement, self._velocity)
        for field in (self._displacement, self._velocity):
            kernels.divide(axes, active.nodes, field, solver.M, solver.mass_floor, field)

    def _share(self, rows: Ints, state: Flags, Q: Floats, M: Floats) -> None:
        for value in (SLIDING, STICKING):
            chosen = rows[state == value]
            a, b, n = self.upper[chosen], self.lower[chosen], self._normal[chosen]
            apart = Q[b] - Q[a]
            if value == SLIDING:
                apart = _dot(apart, n)[:, None] * n
            total = np.maximum(M[a] + M[b], np.finfo(float).tiny)[:, None]
            Q[a] += M[b, None] / total * apart
            Q[b] -= M[a, None] / total * apart


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray(np.einsum("nd,nd->n", a, b))

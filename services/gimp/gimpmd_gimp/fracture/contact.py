"""Contact of crack faces: Coulomb friction between the two velocity fields of a node.

A closed pair of nodes moves as one node along the normal of the crack, and in all directions where
it sticks: velocities and impulses are shared by mass. The momentum of the pair is exact, and a
crack that stays closed and sticks has no effect at all. A pair is closed while its faces would
overlap by the end of the step and the impulse that shares its motion presses (Bardenhagen et al.,
CMES 2 (2001) 509). Displacements tell where the faces are (Nairn, CMES 92 (2013) 271): the
displacement and velocity of a point are continued to the face with its own gradients, so neither a
strain nor a strain rate looks like a gap or a closing speed.

A pair slides when sticking would need more than ``friction`` times the normal impulse. Then the
two fields exchange exactly that limit, against the sliding, and the body loses the work of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from gimpmd_gimp.boundary.condition import Condition, Kick
from gimpmd_gimp.fracture.cracks import Cracks
from gimpmd_gimp.grid.clock import Clock
from gimpmd_gimp.grid.nodes import Nodes
from gimpmd_gimp.points.body import Body
from gimpmd_gimp.sweeps import kernels
from gimpmd_schemas.arrays import Bools, Floats, Int32s, Ints

OPEN, SLIDING, STICKING = 0, 1, 2
"""States of a pair."""

CONTACT_CELLS = 4.5
"""Distance from a crack, in cells, within which points touch its pairs of nodes."""


class Contact(Condition):
    """Contact of crack faces on the pairs of nodes along cracks.

    Parameters
    ----------
    cracks : Cracks
    friction : float
        Coulomb's coefficient.

    Attributes
    ----------
    upper, lower : ndarray of int64, shape ``(n,)``
        Node above and node below the crack.
    states : ndarray of int32, shape ``(n,)``
        ``OPEN``, ``SLIDING`` or ``STICKING``, since the last kick.
    dissipated : float
        Work of friction so far, on the nodes that this rank counts.
    """

    needs_velocity: ClassVar[bool] = True

    def __init__(self, cracks: Cracks, friction: float) -> None:
        self._cracks, self._friction = cracks, friction

    def attach(self, body: Body, nodes: Nodes, clock: Clock) -> None:
        """See ``Condition``."""
        super().attach(body, nodes, clock)
        mesh, cracks = body.mesh, self._cracks
        node = np.flatnonzero((mesh.twin >= 0) & mesh.basis)
        x = mesh.positions()[node]
        crack = cracks.nearest(x)
        above = cracks.height(crack, x) >= -1e-9 * mesh.hierarchy.cell
        self._normal = cracks.normal[crack]
        self.upper = np.where(above, node, mesh.twin[node])
        self.lower = np.where(above, mesh.twin[node], node)
        self.states: Int32s = np.zeros(node.size, dtype=np.int32)
        self._finest = mesh.level[node].copy()  # finest level whose forces reach the pair
        for level in range(mesh.hierarchy.top):
            away = mesh.hierarchy.distance(level + 1, x)
            by_finer = (mesh.level[node] == level) & (away < 2.0 * mesh.hierarchy.edge(level))
            self._finest[by_finer] = level + 1
        self._rows = [np.flatnonzero(np.isin(node, active.solved)) for active in nodes.active]
        self._displacement, self._velocity = np.zeros_like(nodes.V), np.zeros_like(nodes.V)
        self._next = self.states.copy()

    def regroup(self) -> None:
        """Find the points near cracks and their heights above them; see ``Condition``."""
        points, cell = self.body.points, self.body.hierarchy.cell
        limit = np.asarray(CONTACT_CELLS * cell / 2.0**points.level, dtype=np.float64)
        self._near = np.flatnonzero(self._cracks.near(points.reference, limit))
        X = points.reference[self._near]
        crack = self._cracks.nearest(X)
        self._to_face = -self._cracks.height(crack, X)[:, None] * self._cracks.normal[crack]

    def leave_out(self, linked: Bools) -> None:
        """All pairs; see ``Condition``."""
        linked[self.upper] = linked[self.lower] = False

    def constrain_velocity(self, V: Floats, coarsest: int, share: float) -> None:
        """Give closed pairs one nodal velocity, as their state demands; see ``Condition``."""
        rows = self._rows[coarsest]
        self._share(rows, self.states[rows], V)

    def constrain_change(self, kick: Kick) -> None:
        """Let pairs exchange impulses; see ``Condition``.

        States change and friction does work only in ``end_kick``. Pairs that forces of finer
        levels reach as well keep their state. A gap that closes within the kick counts as closed.
        """
        nodes, finest = self.nodes, max(kick.levels)
        span, dV, M = kick.span[finest], nodes.dV, nodes.M
        self._sum_face_fields(kick.coarsest)
        self._next = self.states.copy()
        rows = self._rows[kick.coarsest]
        both = (M[self.upper[rows]] > nodes.mass_floor) & (M[self.lower[rows]] > nodes.mass_floor)
        self._next[rows[~both]] = OPEN
        rows = rows[both]
        a, b, n = self.upper[rows], self.lower[rows], self._normal[rows]
        reduced = (M[a] * M[b] / (M[a] + M[b]))[:, None]
        closing = self._velocity[b] - self._velocity[a]
        along = _dot(dV[b] - dV[a], n)
        gap = _dot(self._displacement[a] - self._displacement[b], n)
        speed = along + _dot(closing, n)
        closed = (speed > 0.0) & (gap <= span * speed)

        # compare what sticking needs with what the normal impulse allows
        sliding = closing + dV[b] - dV[a]
        sliding -= _dot(sliding, n)[:, None] * n
        demand = np.linalg.norm(sliding, axis=1)
        limit = self._friction * np.maximum(along, 0.0)
        sticks = (demand <= limit) & (self._friction > 0.0)
        found = np.where(closed, np.where(sticks, STICKING, SLIDING), OPEN)
        self._next[rows] = np.where(self._finest[rows] <= finest, found, self.states[rows])
        self._share(rows, self._next[rows], dV)

        slides = (self._next[rows] == SLIDING) & (demand > 0.0)
        share = np.where(slides, limit / np.where(slides, demand, 1.0), 0.0)
        impulse = reduced * share[:, None] * sliding
        dV[a] += impulse / M[a, None]
        dV[b] -= impulse / M[b, None]
        self._rubbing = (a, b, self.body.mesh.counts[a, None] * impulse)
        self._before = nodes.V[a] - nodes.V[b]

    def end_kick(self) -> None:
        """Accept the states that ``constrain_change`` found; see ``Condition``.

        The work of friction on the body is its impulse times the mean of the sliding velocities
        before and after the kick. This balances the energy of the points exactly.
        """
        self.states[:] = self._next
        a, b, impulse = self._rubbing
        P, M = self.nodes.P, self.nodes.M
        after = P[a] / M[a, None] - P[b] / M[b, None]
        self.dissipated -= 0.5 * float(np.sum(impulse * (self._before + after)))

    def state(self) -> Mapping[str, Any]:
        """See ``Condition``."""
        return {"states": self.states, "dissipated": np.float64(self.dissipated)}

    def restore(self, state: Mapping[str, Any]) -> None:
        """See ``Condition``."""
        self.states[:] = state["states"]
        self.dissipated = float(state["dissipated"])

    def _sum_face_fields(self, coarsest: int) -> None:
        """Displacement and velocity of the points near cracks at their faces, on the nodes."""
        nodes, p, near, s = self.nodes, self.body.points, self._near, self.body.stencils
        L = self.body.velocity_gradient(near, nodes.V)
        F = p.F[near] - np.eye(p.dim)
        u, v = np.zeros_like(p.v), np.zeros_like(p.v)
        u[near] = p.x[near] - p.reference[near] + np.einsum("nij,nj->ni", F, self._to_face)
        v[near] = p.v[near] + np.einsum("nij,nj->ni", L, self._to_face)
        fields = (self._displacement, self._velocity)
        nodes.clear(coarsest, *fields)
        for at_points, field in zip((u, v), fields, strict=True):
            kernels.scatter_vector(near, 0, near.size, s, p.mass, at_points, field)
        nodes.complete(coarsest, *fields)
        for field in fields:
            nodes.divide(coarsest, field, field)

    def _share(self, rows: Ints, states: Int32s, Q: Floats) -> None:
        """Share a nodal field between the nodes of closed pairs by mass, in place."""
        M = self.nodes.M
        for value in (SLIDING, STICKING):
            chosen = rows[states == value]
            a, b, n = self.upper[chosen], self.lower[chosen], self._normal[chosen]
            apart = Q[b] - Q[a]
            if value == SLIDING:
                apart = _dot(apart, n)[:, None] * n
            total = np.maximum(M[a] + M[b], np.finfo(float).tiny)[:, None]
            Q[a] += M[b, None] / total * apart
            Q[b] -= M[a, None] / total * apart


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray(np.einsum("nd,nd->n", a, b))

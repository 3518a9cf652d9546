"""Nodal fields of one rank: sums over the points, and what is solved from them.

A nodal sum has three stages. ``clear`` sets it to zero, sweeps over the points add to it, and
``complete`` moves the parts on constrained nodes to their parents and adds the parts of the other
ranks. Every operation works on the nodes of one *active set*: those that take part when a given
level is the coarsest that steps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gimpmd_gimp.grid import subcycling
from gimpmd_gimp.grid.constraints import Constraints
from gimpmd_gimp.grid.halo import Halo
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.sweeps import kernels
from gimpmd_gimp.sweeps.threads import Team
from gimpmd_schemas.arrays import Bools, Floats, Ints


@dataclass(frozen=True)
class ActiveSet:
    """Nodes that take part when a level is the coarsest that steps.

    Attributes
    ----------
    solved : ndarray of int64
        Nodes of the basis with complete sums: their velocity is solved.
    cleared : ndarray of int64
        All nodes that get sums, constrained nodes and their parents included.
    unsolved : ndarray of int64
        Cleared nodes that are not solved.
    cleared_runs, unsolved_runs : ndarray of int64, shape ``(n, 2)``
        The same as runs of consecutive nodes: the first node and the one after the last.
    constraints : Constraints
        Those of the cleared nodes.
    halo : Halo
        Exchanges the sums that ranks share.
    """

    solved: Ints
    cleared: Ints
    unsolved: Ints
    cleared_runs: Ints
    unsolved_runs: Ints
    constraints: Constraints
    halo: Halo


def make_active_set(mesh: Mesh, level: int) -> ActiveSet:
    """Nodes that take part when ``level`` is the coarsest that steps."""
    cleared = subcycling.summed_nodes(mesh, level)
    constraints = mesh.constraints.among(cleared)
    shared = {rank: ids[cleared[ids]] for rank, ids in mesh.shared.items()}
    cleared[constraints.parent] = True
    solved = subcycling.complete_nodes(mesh, level) & mesh.basis
    unsolved = cleared & ~solved
    return ActiveSet(
        solved=np.flatnonzero(solved),
        cleared=np.flatnonzero(cleared),
        unsolved=np.flatnonzero(unsolved),
        cleared_runs=_runs(cleared),
        unsolved_runs=_runs(unsolved),
        constraints=constraints,
        halo=Halo(mesh.comm, {rank: ids for rank, ids in shared.items() if ids.size}),
    )


def _runs(chosen: Bools) -> Ints:
    """First node, and the one after the last, of every run of chosen nodes; shape ``(n, 2)``."""
    bounded = np.concatenate([[False], chosen, [False]])
    return np.flatnonzero(bounded[1:] != bounded[:-1]).reshape(-1, 2)


class Nodes:
    """Nodal fields of one rank, in flat arrays as the mesh numbers its nodes.

    Parameters
    ----------
    mesh : Mesh
    team : Team
        Threads that share the work.
    mass_floor : float
        Nodes with at most this mass have no velocity.
    viscous : bool
        Whether any condition uses dashpots.

    Attributes
    ----------
    active : list of ActiveSet
        One for each level as the coarsest that steps.
    M : ndarray, shape ``(size,)``
        Mass.
    V, P : ndarray, shape ``(size, d)``
        Velocity and momentum.
    dV : ndarray, shape ``(size, d)``
        Change of the velocity in the present kick.
    impulse : ndarray, shape ``(size, d)``
        Impulse of the internal forces, and then of all forces.
    loads : ndarray, shape ``(size, d)``
        Impulse of the external forces.
    dashpot : ndarray, shape ``(size, d)``, or ``(0, d)`` without dashpots
        Viscous coefficient times the length of the kick.
    """

    def __init__(self, mesh: Mesh, team: Team, mass_floor: float, viscous: bool = False) -> None:
        self.mesh, self.team, self.mass_floor = mesh, team, mass_floor
        size, d = mesh.size, mesh.hierarchy.dim
        self.axes = (0,) * d
        self.active = [make_active_set(mesh, level) for level in range(mesh.hierarchy.top + 1)]
        self.M = np.zeros(size)
        self.V, self.P, self.dV = (np.zeros((size, d)) for _ in range(3))
        self.impulse, self.loads = np.zeros((size, d)), np.zeros((size, d))
        self.dashpot = np.zeros((size if viscous else 0, d))

    def clear(self, level: int, *sums: Floats) -> None:
        """Set nodal sums ``(size, k)`` to zero."""
        for field in sums:
            kernels.clear((0,) * field.shape[1], self.active[level].cleared_runs, field)

    def complete(self, level: int, *sums: Floats) -> None:
        """Add up the parts of nodal sums ``(size, k)``, in place; collective."""
        active = self.active[level]
        for field in sums:
            active.constraints.restrict(field)
        active.halo.complete(*sums)

    def prolong(self, level: int, field: Floats) -> None:
        """Interpolate a field from parents to constrained nodes, in place."""
        self.active[level].constraints.prolong(field)

    def divide(self, level: int, P: Floats, V: Floats) -> None:
        """``V_i = P_i / m_i``; zero on nodes that hardly have any mass."""
        self.team.solve(
            lambda nodes: kernels.divide(self.axes, nodes, P, self.M, self.mass_floor, V),
            self.active[level].solved,
        )

    def add(self, level: int, field: Floats, factor: float, into: Floats) -> None:
        """``into_i += factor field_i``."""
        self.team.solve(
            lambda nodes: kernels.add(self.axes, nodes, field, factor, into),
            self.active[level].solved,
        )

    def carrying(self, level: int, impulse: Floats, counts: Floats) -> Ints:
        """Solved nodes that count in a work, and on which an impulse acts."""
        parts = self.team.solve(
            lambda nodes: kernels.carrying(self.axes, nodes, impulse, counts),
            self.active[level].solved,
        )
        return np.concatenate([np.empty(0, dtype=np.int64), *parts])

    def work(self, nodes: Ints, impulse: Floats, counts: Floats) -> float:
        """Sum of ``counts_i J_i . V_i`` over nodes: the work of an impulse at their velocity."""
        return float(kernels.work(self.axes, nodes, impulse, self.V, counts))

"""The stages from which integrators compose a step (``integrators.py``).

Stages work on the nodes and points that take part when a given level is the coarsest that steps,
and share the sums that one stage leaves for the next.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain

import numpy as np

from gimpmd_gimp.boundary.condition import Condition, Kick
from gimpmd_gimp.grid.clock import Clock
from gimpmd_gimp.grid.nodes import Nodes
from gimpmd_gimp.points.body import Body
from gimpmd_gimp.points.groups import MovedWith, OfLevel, OfLevels, Summed, SummedBeside
from gimpmd_gimp.step.damping import Damping
from gimpmd_gimp.step.dispersion import Dispersion, make_dispersion
from gimpmd_gimp.step.inner import InnerPoints
from gimpmd_gimp.step.work import Work
from gimpmd_gimp.sweeps import kernels
from gimpmd_gimp.sweeps.runner import Sweep
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.errors import BackendError


class Stages:
    """Stages of a step.

    Parameters
    ----------
    body : Body
    nodes : Nodes
    clock : Clock
    conditions : list of Condition
        In the order in which they act.
    damping : Damping or None
    inner : InnerPoints or None
    work : Work
    beta : float
        Strength of the dispersion correction, 0 for none.

    Attributes
    ----------
    dispersion : Dispersion or None
        The correction, renewed whenever points are sorted.
    kick_sums : ndarray, shape ``(1 + d,)``
        Kinetic energy and momentum of this rank's points in the middle of the last kick of all
        levels together. With MUSL that is the beginning of the step, where they are exact.
    """

    def __init__(
        self,
        body: Body,
        nodes: Nodes,
        clock: Clock,
        conditions: list[Condition],
        damping: Damping | None,
        inner: InnerPoints | None,
        work: Work,
        beta: float,
    ) -> None:
        self.body, self.nodes, self.clock, self.conditions = body, nodes, clock, conditions
        self.damping, self.inner, self.work = damping, inner, work
        self._beta = beta
        self.dispersion: Dispersion | None = None
        self._loaded = any(condition.external for condition in conditions)
        self._needs_velocity = damping is not None or any(c.needs_velocity for c in conditions)
        self._reimposed = [condition for condition in conditions if condition.reimposed]
        self.kick_sums = np.zeros(1 + body.hierarchy.dim)
        self._after_kick = np.zeros_like(nodes.V)
        self._prepared = False

    def regroup(self) -> None:
        """Find what depends on the order of the points anew."""
        self._dv_beside = np.zeros_like(self.body.points.v)
        self._prepared = False
        for condition in self.conditions:
            condition.regroup()
        if self.damping is not None:
            self.damping.regroup(self.body.points)
        if self.body.total_lagrangian:  # masses never change
            self._sum_mass(0)
            if self.inner is not None:
                self.inner.sum_mass(0)
        if self._beta > 0.0:
            self.dispersion = make_dispersion(self._beta, self.body, self.nodes, self.conditions)

    # --- points to nodes --------------------------------------------------------------------

    def project(self, coarsest: int = 0) -> None:
        """Nodal mass and velocity of the points (paper Eq. 16).

        ``M_i = sum_p S_ip m_p`` and ``V_i = sum_p S_ip m_p v_p / M_i``
        """
        nodes, group = self.nodes, Summed(coarsest)
        if self.body.total_lagrangian:
            nodes.clear(coarsest, nodes.P)
            self.body.scatter(group, self.body.points.v, nodes.P)
            nodes.complete(coarsest, nodes.P)
        else:
            M = nodes.M[:, None]
            nodes.clear(coarsest, M, nodes.P)
            self.body.scatter_momentum(group, nodes.M, nodes.P)
            nodes.complete(coarsest, M, nodes.P)
        self.velocity(coarsest)

    def sum_mass(self, coarsest: int) -> None:
        """Nodal mass, and the nodal velocity as well if forces depend on it."""
        if self._needs_velocity:
            self.project(coarsest)
        elif not self.body.total_lagrangian:
            self._sum_mass(coarsest)

    def _sum_mass(self, coarsest: int) -> None:
        M = self.nodes.M
        self.nodes.clear(coarsest, M[:, None])
        self.body.scatter_mass(Summed(coarsest), M)
        self.nodes.complete(coarsest, M[:, None])

    def prepare(self) -> None:
        """Sum the impulse of the stress for the next step, where stencils never change."""
        if not self._prepared:
            level = self.clock.coarsest()
            span = np.array([self.clock.next_span(one) for one in self.clock.levels])
            self._sum_stress(Kick(level, range(level, self.clock.top + 1), self.clock.time, span))
            self._prepared = True

    def discard_prepared(self) -> None:
        """Forget what ``prepare`` has summed, because a kick of another length comes first."""
        self._prepared = False

    # --- forces -----------------------------------------------------------------------------

    def push(self, kick: Kick, before: Sequence[Sweep] = ()) -> None:
        """Change of the nodal velocity by all that acts: ``dV_i = J_i / M_i`` (paper Eq. 17).

        ``before`` are sweeps to run before the internal force of the same points is summed.
        """
        nodes, level = self.nodes, kick.coarsest
        inner = self.inner if self.clock.top in kick.levels else None
        sums = [nodes.loads] if self._loaded else []
        sums += [inner.impulse] if inner else []
        dashpots = [nodes.dashpot] if nodes.dashpot.size else []

        if not self._prepared:
            self._sum_stress(kick, before)
        self._prepared = False
        nodes.clear(level, *sums, *dashpots)
        self._add_impulses(kick)
        if inner:
            inner.sum_impulse(kick)
        nodes.complete(level, nodes.impulse, *sums, *dashpots)

        self._solve_change(level, sums, inner)
        for condition in self.conditions:
            condition.constrain_change(kick)
        if self.dispersion is not None:
            self.dispersion.correct_change(level, nodes, nodes.dV)
            for condition in self._reimposed:
                condition.constrain_change(kick)
        nodes.prolong(level, nodes.dV)
        if inner:
            inner.subtract_inertia(level)
        self.work.find_nodes(level)

    def sum_loads(self, kick: Kick) -> None:
        """Impulse of the external loads only."""
        self._prepared = False  # conditions may add to the internal impulse as well
        self.nodes.clear(kick.coarsest, self.nodes.loads)
        self._add_impulses(kick)
        self.nodes.complete(kick.coarsest, self.nodes.loads)
        self.work.find_nodes(kick.coarsest)

    def _sum_stress(self, kick: Kick, before: Sequence[Sweep] = ()) -> None:
        """Impulse of the stress on some levels; sums stay this rank's part."""
        self.nodes.clear(kick.coarsest, self.nodes.impulse)
        internal = [
            self.body.internal_force(OfLevel(one), kick.span[one], self.nodes.impulse)
            for one in kick.levels
        ]
        self.body.run(*before, *chain.from_iterable(internal))

    def _add_impulses(self, kick: Kick) -> None:
        for level in kick.levels:
            for condition in self.conditions:
                condition.add_impulse(kick, level)

    def _solve_change(
        self, coarsest: int, sums: Sequence[Floats], inner: InnerPoints | None
    ) -> None:
        """``M_i dV_i = J_i - C_i (V_i + dV_i / 2)``, C being the dashpots times the span."""
        nodes, active = self.nodes, self.nodes.active[coarsest]

        def solve(some: Ints) -> None:
            if inner:
                inner.relieve_rim(some)
            for one in sums:
                kernels.add(nodes.axes, some, one, 1.0, nodes.impulse)
            kernels.divide(nodes.axes, some, nodes.impulse, nodes.M, nodes.mass_floor, nodes.dV)

        nodes.team.solve(solve, active.solved)
        kernels.clear(nodes.axes, active.unsolved_runs, nodes.dV)
        if nodes.dashpot.size:
            arrays = (nodes.dashpot, nodes.M, nodes.mass_floor, nodes.V, nodes.dV, nodes.loads)
            kernels.damp_change(active.solved, *arrays)

    # --- nodes to points --------------------------------------------------------------------

    def kick(self, kick: Kick, advance: float = 0.0, along: Sequence[Sweep] = ()) -> None:
        """Kick the points and sum their new momentum (FLIP, paper Eq. 5).

        ``v_p += sum_i S_ip dV_i`` and ``P_i = sum_p S_ip m_p v_p``

        Parameters
        ----------
        advance : float
            ``V_i += advance dV_i`` before.
        along : sequence of Sweep
            Sweeps to run along the way; they must not read P.
        """
        nodes, body, clock, level = self.nodes, self.body, self.clock, kick.coarsest
        first, last = kick.levels[0], kick.levels[-1]
        # the first kick of velocities at half steps starts from whole steps
        share = 0.5 if clock.steps or clock.at_whole_steps(first) else 0.0
        clock.end_kick(kick.levels)
        if self.damping is not None:
            self._after_kick[:] = nodes.V + nodes.dV
        if advance:
            self._advance(level, advance)
        nodes.clear(level, nodes.P)
        p, own, beside = body.points, OfLevels(first, last), SummedBeside(level, first, last)
        sums = np.zeros((body.stripe_count, 1 + p.dim))
        point, arrays = (nodes.dV, p.mass, p.v), (nodes.P, share, body.stripe, sums)
        body.run(body.sweep(kernels.kick, own, *point, p.dv, *arrays, to_nodes=True), *along)
        body.run(body.sweep(kernels.kick, beside, *point, self._dv_beside, *arrays, to_nodes=True))
        if level == 0:
            self.kick_sums = np.sum(sums, axis=0)
            self._check_energy()
        if self.damping is not None:
            self.work.damped += self.damping.act(body, own, self._after_kick, clock.span)
            nodes.clear(level, nodes.P)
            for group in (own, beside):
                body.scatter(group, p.v, nodes.P)
        nodes.complete(level, nodes.P)
        for condition in self.conditions:
            condition.end_kick()

    def velocity(self, coarsest: int) -> None:
        """Nodal velocity of the points' momentum: ``V_i = P_i / M_i``."""
        self.solve_velocity(coarsest, self.nodes.P, self.nodes.V)

    def solve_velocity(self, coarsest: int, P: Floats, V: Floats, share: float = 1.0) -> None:
        """``V_i = P_i / M_i`` for a complete momentum, with all conditions on velocities.

        Prescribed components take ``share`` of their value.
        """
        self.nodes.divide(coarsest, P, V)
        for condition in self.conditions:
            condition.constrain_velocity(V, coarsest, share)
        if self.dispersion is not None:
            self.dispersion.correct_velocity(coarsest, self.nodes, V)
            for condition in self._reimposed:
                condition.constrain_velocity(V, coarsest, share)
        self.nodes.prolong(coarsest, V)

    def deforming(self, levels: Sequence[int], share: float, move: bool = True) -> list[Sweep]:
        """Sweeps that deform, and move, the points of some levels over a fraction of their steps.

        ``F_p <- (1 + dt sum_i V_i grad S_ip) F_p`` and ``x_p += dt sum_i S_ip V_i``
        """
        sweeps: list[Sweep] = []
        for level in levels:
            dt = share * self.clock.dt_of(level)
            group, x_step = MovedWith(level), dt if move else 0.0
            sweeps += self.body.deforming(group, self.nodes.V, dt, x_step)
        return sweeps

    def moving(self, levels: Sequence[int]) -> list[Sweep]:
        """Sweeps that move the points of some levels: ``x_p += dt sum_i S_ip V_i``."""
        return [
            self.body.moving(MovedWith(one), self.nodes.V, self.clock.dt_of(one)) for one in levels
        ]

    def slow(self, level: int) -> None:
        """Correct the motion of a level for damping at the end of its step; see `Damping.slow`."""
        if self.damping is not None:
            self.damping.slow(self.body, MovedWith(level), self._after_kick, self.clock.span)

    def _advance(self, coarsest: int, share: float) -> None:
        """``V_i += share dV_i``."""
        self.nodes.add(coarsest, self.nodes.dV, share, self.nodes.V)
        for condition in self.conditions:
            condition.constrain_motion()
        self.nodes.prolong(coarsest, self.nodes.V)

    def _check_energy(self) -> None:
        """Stop a run that has blown up where no point can leave the grid and show it."""
        finite = bool(np.isfinite(self.kick_sums[0]))
        if self.body.total_lagrangian and self.body.mesh.largest(float(not finite)) > 0.0:
            raise BackendError(
                f"GIMP: the kinetic energy is not finite at t = {self.clock.time:g}; the run is "
                "unstable: reduce time.md_steps, time.step or the load"
            )

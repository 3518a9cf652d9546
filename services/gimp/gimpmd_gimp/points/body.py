"""The body: material points on the grid of one rank, and the sweeps that use them.

The body keeps its points sorted so that sweeps are fast, knows which points form a group
(``groups.py``), and holds the stencil of every point: the nodes that it touches and their weights.

In the *reference configuration* (total Lagrangian) points stay on the grid where they stand at
rest, so their order and stencils never change. In the *current* one points move over the grid:
their stencils are computed in every step, and they are sorted again once one has drifted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gimpmd_gimp.grid import subcycling
from gimpmd_gimp.grid.mesh import Discontinuities, Mesh
from gimpmd_gimp.laws import Law
from gimpmd_gimp.laws.law import history_size, is_inelastic
from gimpmd_gimp.points.distribution import in_blocks, settle, sort
from gimpmd_gimp.points.groups import ALL, FIRST_FREE_BIT, Flagged, Group, MovedFrom
from gimpmd_gimp.points.material_points import Configuration, MaterialPoints
from gimpmd_gimp.points.splitting import Changes, Splitting
from gimpmd_gimp.sweeps import kernels
from gimpmd_gimp.sweeps.runner import Sweep, run_sweeps
from gimpmd_gimp.sweeps.threads import Stripes, Team, make_stripes
from gimpmd_schemas.arrays import Bools, Floats, Int32s, Ints
from gimpmd_schemas.errors import BackendError

Interpolation = Literal["linear", "ugimp", "cpgimp", "bspline"]


@dataclass(frozen=True)
class Placement:
    """How points lie on the grid.

    Attributes
    ----------
    configuration : whether points move over the grid.
    interpolation : weights of the points. ``cpgimp`` stretches the domains of the points with F.
    corrected : whether the dispersion correction is in use, which needs finer time steps in a
        wider band around finer levels.
    """

    configuration: Configuration = "current"
    interpolation: Interpolation = "ugimp"
    corrected: bool = False


class Body:
    """Material points of one rank.

    Parameters
    ----------
    mesh : Mesh
    points : MaterialPoints
        Any points of the body; each goes to the rank that holds its position.
    law : Law
    placement : Placement
    team : Team
        Threads that share the sweeps.
    cracks : Discontinuities, optional
        Cracks for which the mesh has twins.

    Raises
    ------
    ValueError
        The points do not have the history variables of the law.

    Attributes
    ----------
    points : MaterialPoints
        In the order of the sweeps.
    stencils : Stencils
    stripe : ndarray of int64, shape ``(n,)``
        Stripe of every point (``threads.py``).
    stripe_count : int
        Number of stripes.
    total_lagrangian : bool
        Whether points stay on the grid where they stand in the reference configuration.
    stretched : bool
        Whether the domains of the points follow F.
    """

    def __init__(
        self,
        mesh: Mesh,
        points: MaterialPoints,
        law: Law,
        placement: Placement,
        team: Team,
        cracks: Discontinuities | None = None,
    ) -> None:
        if points.history.shape[1] != history_size(law):
            raise ValueError(
                f"{law.name} has {history_size(law)} history variables, but the points have "
                f"{points.history.shape[1]}"
            )
        self.mesh, self.hierarchy, self.law, self.team = mesh, mesh.hierarchy, law, team
        self.cracks, self.configuration = cracks, placement.configuration
        self._placement = placement
        self.total_lagrangian = placement.configuration == "reference"
        self.stretched = placement.interpolation == "cpgimp"
        nominal_half = mesh.largest(float(points.half.max(initial=0.0)))
        self._splitting = Splitting(mesh, placement.configuration, nominal_half)
        self._next_bit = FIRST_FREE_BIT
        self.arrange(settle(mesh, points, placement.configuration))

    # --- points and groups ------------------------------------------------------------------

    @property
    def place(self) -> Floats:
        """Positions of the points on the grid, shape ``(n, d)``."""
        return self.points.on_grid(self.configuration)

    def add_group(self, mask: Bools) -> Group:
        """Make a group of the points that a mask ``(n,)`` selects now."""
        group = Flagged(self._next_bit)
        self._next_bit *= 2
        self.points.flags[mask] |= np.int32(group.bit)
        return group

    def mask(self, group: Group) -> Bools:
        """Which points belong to a group, shape ``(n,)``."""
        return group.mask(self.points, self._summed)

    def stripes(self, group: Group) -> Stripes:
        """Points of a group as sweeps take them; valid until points are sorted again."""
        known = self._stripes.get(group)
        if known is None:
            mask = self.mask(group)
            if group != ALL and mask.all():  # as on a single level: keep one order of all points
                known = self.stripes(ALL)
            else:
                known = make_stripes(np.flatnonzero(mask), self.stripe)
            self._stripes[group] = known
        return known

    # --- order and stencils -----------------------------------------------------------------

    def arrange(self, points: MaterialPoints, time: float = 0.0) -> None:
        """Take points that are on the right level and rank: sort them and fill their stencils.

        Parameters
        ----------
        points : MaterialPoints
        time : float
            Present time, for the message of an error.

        Raises
        ------
        BackendError
            A point has left the background grid.
        """
        self.points = points
        self._home, self.stripe = sort(self.mesh, points, self.configuration)
        self.stripe_count = int(self.stripe.max(initial=0)) + 1
        h, place, d = self.hierarchy, self.place, self.hierarchy.dim
        points.rate[:] = subcycling.rate_of(points.level, place, h, self._placement.corrected)
        self._summed = subcycling.finest_summed(points.level, place, h)
        self._stripes: dict[Group, Stripes] = {}
        self._stress, self._density = np.zeros((points.count, d, d)), np.zeros(points.count)
        self._near_cracks = self.cut_candidates(points.level, place)
        detours = self._near_cracks.size
        self.stencils = kernels.make_stencils(points.block, self.mesh.frames, detours)
        self._splitting.watch(points)
        self._fill(ALL, time)

    def refresh(self, level: int, time: float) -> bool:
        """Compute the stencils of the points that move with a level's steps; collective.

        Returns
        -------
        bool
            Whether points should be sorted again, or change level.

        Raises
        ------
        BackendError
            A point has left the background grid.
        """
        if self.total_lagrangian:
            return False
        drifted = self._fill(MovedFrom(level), time)
        return level == 0 and (drifted or self._splitting.is_due(self.points))

    def changes(self) -> Changes | None:
        """Points that change level now, or None if no rank has any; collective."""
        return self._splitting.find(self.points)

    def changed(self, changes: Changes, V: Floats) -> MaterialPoints:
        """Points after they changed level, given the nodal velocity ``(size, d)``; collective."""
        L = self.velocity_gradient(np.flatnonzero(changes.split), V)
        return self._splitting.apply(self.points, changes, L)

    def settle(self, points: MaterialPoints, time: float) -> None:
        """Send points to the ranks that hold their positions, and arrange them; collective."""
        self.arrange(settle(self.mesh, points, self.configuration), time)

    def cut_candidates(self, level: Int32s, x: Floats) -> Ints:
        """Points, by level and position on the grid, whose stencils a crack may cut."""
        if self.cracks is None:
            return np.empty(0, dtype=np.int64)
        return self.cracks.cut_candidates(level, x)

    def half(self) -> Floats:
        """Half-widths of the domains in the weights, in cells, shape ``(n, d)``."""
        if self._placement.interpolation != "linear":
            return self.points.half
        return np.full_like(self.points.half, kernels.HAT)

    def _fill(self, group: Group, time: float) -> bool:
        """Compute stencils; says whether any point, on any rank, has drifted from its home."""
        stripes, p = self.stripes(group), self.points
        kind = kernels.BSPLINE if self._placement.interpolation == "bspline" else kernels.GIMP
        where = (self.stencils, self.mesh.frames, kind, self.stretched)
        points = (self.place, self.half(), p.F, self._home)
        parts = self.team.gather(
            lambda first, last: kernels.fill_stencils(stripes.index, first, last, *where, *points),
            stripes,
        )
        counts = np.sum(parts, axis=0)
        if self.mesh.ranks > 1:
            counts = self.mesh.comm.allreduce(counts)
        if counts[0]:
            raise BackendError(
                f"GIMP: a material point {self._lost_point()} left the background grid at "
                f"t = {time:g}; the run is unstable, or the load is too high: reduce "
                "time.md_steps or the load"
            )
        if self.cracks is not None:
            near = self._near_cracks
            self.cracks.fill_detours(self.mesh, p.reference, self.place, near, self.stencils)
        return bool(counts[1])

    def _lost_point(self) -> str:
        p, t = self.points, in_blocks(self.mesh, self.points, self.configuration)
        inside = ((t >= 0.5) & (t < self.mesh.frames.shape[p.block] - 1.5)).all(axis=1)
        lost = np.flatnonzero(~inside)
        if lost.size == 0:
            return "on another rank"
        return "from (" + ", ".join(f"{c:g}" for c in p.reference[lost[0]]) + ")"

    # --- sweeps -----------------------------------------------------------------------------

    def sweep(
        self, kernel: Callable[..., None], group: Group, *arrays: object, to_nodes: bool = False
    ) -> Sweep:
        """Sweep of a kernel over the points of a group with their stencils."""
        s = self.stencils

        def work(stripes: Stripes, first: int, last: int) -> None:
            kernel(stripes.index, first, last, s, *arrays)

        return Sweep(self.stripes(group), work, to_nodes)

    def run(self, *sweeps: Sweep) -> None:
        """Run sweeps in order; see ``run_sweeps``."""
        run_sweeps(self.team, sweeps)

    def scatter_mass(self, group: Group, M: Floats) -> None:
        """``M_i += sum_p S_ip m_p`` (paper section 3.1)."""
        self.run(self.sweep(kernels.scatter_mass, group, self.points.mass, M, to_nodes=True))

    def scatter_momentum(self, group: Group, M: Floats, P: Floats) -> None:
        """``M_i += sum_p S_ip m_p`` and ``P_i += sum_p S_ip m_p v_p`` (paper Eq. 16)."""
        p = self.points
        self.run(self.sweep(kernels.scatter_momentum, group, p.mass, p.v, M, P, to_nodes=True))

    def scatter(self, group: Group, q: Floats, Q: Floats) -> None:
        """``Q_i += sum_p S_ip m_p q_p``."""
        self.run(self.sweep(kernels.scatter_vector, group, self.points.mass, q, Q, to_nodes=True))

    def gather(self, group: Group, Q: Floats, factor: float, q: Floats) -> None:
        """``q_p += factor sum_i S_ip Q_i`` (paper Eq. 5)."""
        self.run(self.sweep(kernels.gather_vector, group, Q, factor, q))

    def moving(self, group: Group, V: Floats, dt: float) -> Sweep:
        """Sweep that moves points: ``x_p += dt sum_i S_ip V_i``."""
        return self.sweep(kernels.gather_vector, group, V, dt, self.points.x)

    def deforming(self, group: Group, V: Floats, dt: float, x_step: float) -> Sequence[Sweep]:
        """Sweeps that deform points over ``dt`` and move them over ``x_step``.

        ``F_p <- (1 + dt L_p) F_p`` with ``L_p = sum_i V_i grad S_ip`` (paper Eqs. 7, 8), or
        ``F_p += dt L_p`` for small strains and in the reference configuration. History variables
        follow F.
        """
        p, chained = self.points, self.law.finite and not self.total_lagrangian
        arrays = (V, dt, chained, p.F, x_step, p.x)
        return self.sweep(kernels.gather_motion, group, *arrays), *self.updating(group)

    def updating(self, group: Group) -> Sequence[Sweep]:
        """Sweep that advances the history variables to the present F; none for elastic laws."""
        p, law = self.points, self.law
        if not is_inelastic(law):
            return ()

        def update(stripes: Stripes, first: int, last: int) -> None:
            law.update(stripes.order, first, last, p.F, p.history)

        return (Sweep(self.stripes(group), update, False),)

    def internal_force(self, group: Group, span: float, impulse: Floats) -> Sequence[Sweep]:
        """Sweeps that add the impulse of the stress: ``J_i -= span sum_p V_p tau_p . grad S_ip``.

        In the reference configuration tau is the nominal stress (paper section 2, Eq. 2).
        """
        p, law = self.points, self.law

        def stress(stripes: Stripes, first: int, last: int) -> None:
            law.stress(stripes.order, first, last, p.F, p.history, self._stress)

        nominal = self.total_lagrangian and law.finite
        kernel = kernels.scatter_nominal_force if nominal else kernels.scatter_force
        arrays = (span, p.volume, *([p.F] if nominal else []), self._stress, impulse)
        force = self.sweep(kernel, group, *arrays, to_nodes=True)
        return Sweep(self.stripes(group), stress, False), force

    def velocity_gradient(self, chosen: Ints, V: Floats) -> Floats:
        """``L_p = sum_i V_i grad S_ip`` at some points, shape ``(len(chosen), d, d)``."""
        p = self.points
        F, x = np.zeros_like(p.F), p.x.copy()
        if chosen.size:
            arrays = (self.stencils, V, 1.0, False, F, 0.0, x)
            kernels.gather_motion(chosen, 0, chosen.size, *arrays)
        return F[chosen]

    def stress(self, group: Group = ALL) -> Floats:
        """Kirchhoff stress of a group now, in its rows of an array ``(n, d, d)``."""
        self._evaluate(self.law.stress, group, self._stress)
        return self._stress

    def energy_density(self, group: Group = ALL) -> Floats:
        """Strain energy per reference volume of a group now, in its rows of an array ``(n,)``."""
        self._evaluate(self.law.energy, group, self._density)
        return self._density

    def dissipation(self, group: Group = ALL) -> float:
        """Energy that the law has dissipated in a group so far, on this rank."""
        law, p = self.law, self.points
        if not is_inelastic(law):
            return 0.0
        order, density = self.stripes(group).order, np.zeros(p.count)
        law.dissipation(order, 0, order.size, p.history, density)
        return float(p.volume[order] @ density[order])

    def _evaluate(self, function: Callable[..., None], group: Group, out: Floats) -> None:
        """Evaluate a function of the law at the points of a group."""
        stripes, p = self.stripes(group), self.points
        self.team.gather(
            lambda first, last: function(stripes.order, first, last, p.F, p.history, out), stripes
        )

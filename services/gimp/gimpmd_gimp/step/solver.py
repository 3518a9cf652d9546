"""The GIMP solver: a body on nested levels, advanced in time.

Levels step by force splitting (r-RESPA). The forces of the points of level l kick velocities with
the time step of that level, ``dt_l = 2^(top - l) dt``. All levels share one composite basis, so
momentum is exact, and the step is a symplectic map as long as points stay in their cells. ``step``
advances the finest level once, and the coarser ones when it is their turn.

In the *reference configuration* (total Lagrangian) points stay on the grid where they stand at
rest: stencils, nodal masses and the places of points are found once, and nodes carry
displacements. No point crosses a cell, so the step is a symplectic map for finite strains and any
motion too. In the *current* configuration points move over the grid.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from itertools import pairwise

import numpy as np

from gimpmd_gimp.boundary.condition import Condition
from gimpmd_gimp.fracture.contact import Contact
from gimpmd_gimp.fracture.cracks import Cracks
from gimpmd_gimp.grid.clock import Clock
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.grid.nodes import Nodes
from gimpmd_gimp.laws import Law
from gimpmd_gimp.points.body import Body
from gimpmd_gimp.points.groups import ALL, INNER, RIM, Group
from gimpmd_gimp.points.material_points import MaterialPoints
from gimpmd_gimp.step.damping import Damping
from gimpmd_gimp.step.energies import (
    bring_to_present,
    present_velocities,
    strain_energy,
    sum_energies,
)
from gimpmd_gimp.step.inner import InnerPoints
from gimpmd_gimp.step.integrators import INTEGRATORS
from gimpmd_gimp.step.method import Method
from gimpmd_gimp.step.stages import Stages
from gimpmd_gimp.step.work import Work
from gimpmd_gimp.sweeps.runner import Sweep
from gimpmd_gimp.sweeps.threads import Team
from gimpmd_schemas.arrays import Bools, Floats
from gimpmd_schemas.wire.energies import Energies

MASS_FLOOR = 1e-12
"""Nodes with less than this fraction of a full node's mass have no velocity."""


class Solver:
    """GIMP on the levels of a mesh.

    Parameters
    ----------
    mesh : Mesh
    points : MaterialPoints
        Any points of the body; each goes to the rank that holds its position.
    law : Law
    method : Method
        How a step is taken.
    dt : float
        Time step of the finest level.
    conditions : sequence of Condition
        Conditions on the body, in the order in which they act. The solver works with copies.
    cracks : Cracks, optional
        Cracks for which the mesh has twins. If they have friction, their contact acts after all
        other conditions.
    inner, rim : ndarray of bool, shape ``(n,)``, optional
        Which points follow another code, and which of them are their last layer
        (``step/inner.py``).
    counted : callable, optional
        Nodes at which positions ``(n, d)`` count in the external work, and points in what damping
        takes; all if left out.
    threads : int
        Threads that share the sweeps.

    Attributes
    ----------
    body : Body
        Points, groups and stencils.
    nodes : Nodes
        Nodal fields.
    M : ndarray, shape ``(size,)``
        Nodal mass.
    V : ndarray, shape ``(size, d)``
        Nodal velocity after the last step: the projected new momentum of the points.
    clock : Clock
        Time of every level.
    conditions : list of Condition
    stages : Stages
    work : Work
    work_now : float
        External work at the time of the last ``energies``.
    """

    def __init__(
        self,
        mesh: Mesh,
        points: MaterialPoints,
        law: Law,
        method: Method,
        dt: float,
        *,
        conditions: Sequence[Condition] = (),
        cracks: Cracks | None = None,
        inner: Bools | None = None,
        rim: Bools | None = None,
        counted: Callable[[Floats], Bools] | None = None,
        threads: int = 1,
    ) -> None:
        self.mesh, self.hierarchy, self.law, self.method = mesh, mesh.hierarchy, law, method
        self.top, self.work_now = mesh.hierarchy.top, 0.0
        for group, members in ((INNER, inner), (RIM, rim)):
            if members is not None:
                points.flags[members] |= np.int32(group.bit)
        self.clock = Clock(dt, self.top, method.integrator)
        team = Team(threads)
        self.body = Body(mesh, points, law, method.placement, team, cracks)

        self.conditions = [copy(condition) for condition in conditions]
        self.contact: Contact | None = None
        if cracks is not None and cracks.friction is not None:
            self.contact = Contact(cracks, cracks.friction)
            self.conditions.append(self.contact)
        floor = MASS_FLOOR * law.density * self.hierarchy.edge(self.top) ** self.hierarchy.dim
        self.nodes = Nodes(mesh, team, floor, any(one.viscous for one in self.conditions))
        self.M, self.V = self.nodes.M, self.nodes.V
        for condition in self.conditions:
            condition.attach(self.body, self.nodes, self.clock)

        follower = None if inner is None else InnerPoints(self.body, self.nodes, rim is not None)
        counts = mesh.counts * (1.0 if counted is None else counted(mesh.positions()))
        loaded = any(condition.external for condition in self.conditions)
        self.work = Work(self.nodes, counts, loaded, follower)
        damping = Damping(method.damping, counted) if method.damping else None
        parts = (self.body, self.nodes, self.clock, self.conditions)
        self.stages = Stages(*parts, damping, follower, self.work, method.dispersion)
        self._deferred: Sequence[Sweep] = ()
        self.stages.regroup()
        if self.body.changes() is not None:
            self.regroup()
        # the initial strain may be beyond the elastic range
        self.body.run(*self.body.updating(ALL))
        self.stages.project()

    # --- the step ---------------------------------------------------------------------------

    def step(self) -> None:
        """Advance the finest level by one step, and coarser ones when it is their turn.

        Raises
        ------
        BackendError
            A point has left the background grid, or the kinetic energy is not finite.
        """
        self.start_step()
        self.end_step()

    def start_step(self) -> None:
        """Take a step as far as its nodal velocity ``V``, for which others may wait.

        With MUSL the points deform only in ``end_step``.
        """
        self.end_step()
        level = self.clock.coarsest()
        self.refresh(level)
        self.clock.start_kick(range(level, self.top + 1))
        self._deferred = INTEGRATORS[self.method.integrator](self.stages, level)
        self.clock.advance()
        if level == 0 and self._filter_is_due():
            self._filter()

    def end_step(self) -> None:
        """Do what ``start_step`` has left for later."""
        deferred, self._deferred = self._deferred, ()
        self.body.run(*deferred)

    def prepare(self) -> None:
        """Sum the impulse of the stress for the next step, where stencils never change.

        Useful where others wait for ``start_step``. Exact energies must then sum it once more.
        """
        if self.body.total_lagrangian and self.method.integrator == "musl":
            self.stages.prepare()

    def add_condition(self, condition: Condition) -> None:
        """Add a condition that acts before all others, from the next step on.

        Raises
        ------
        ValueError
            The condition needs nodal sums that the solver sets up only at the start.
        """
        if condition.external or condition.viscous or condition.needs_velocity:
            name = type(condition).__name__
            raise ValueError(f"{name} must be one of the solver's conditions from the start")
        condition.attach(self.body, self.nodes, self.clock)
        condition.regroup()
        self.conditions.insert(0, condition)

    # --- points -----------------------------------------------------------------------------

    def refresh(self, level: int = 0) -> None:
        """Compute the stencils of the points that moved; sort points again if one has drifted.

        Raises
        ------
        BackendError
            A point has left the background grid.
        """
        if self.body.refresh(level, self.clock.time):
            self.regroup()

    def regroup(self) -> None:
        """Let points change level and rank, sort them, and compute their stencils; collective.

        Levels know their velocities at different times, so points change level with velocities of
        the present: momentum and energy at that time are those before the change. In the reference
        configuration all points are in place from the start.
        """
        if self.body.total_lagrangian and self.clock.steps:
            return
        body, v = self.body, self.body.points.v
        changes = body.changes()
        if changes is None:
            self.settle(body.points)
            return
        bring_to_present(self.stages, v, 1.0)
        self.stages.project()  # points that split need the velocity gradient
        self.settle(body.changed(changes, self.nodes.V))
        bring_to_present(self.stages, body.points.v, -1.0)

    def settle(self, points: MaterialPoints) -> None:
        """Send points to their ranks, sort them, and compute their stencils; collective."""
        self.body.settle(points, self.clock.time)
        self.stages.regroup()

    def arrange(self, points: MaterialPoints) -> None:
        """Take points that are on the right level and rank, and project their velocities."""
        self.body.arrange(points, self.clock.time)
        self.stages.regroup()
        self.stages.project()

    # --- filter -----------------------------------------------------------------------------

    def _filter_is_due(self) -> bool:
        every, done = self.method.xpic_every, self.clock.steps
        before = done - 2**self.top
        return not self.body.total_lagrangian and every > 0 and done // every > before // every

    def _filter(self) -> None:
        """Remove the null space of FLIP: the XPIC filter (Hammerquist and Nairn 2017)."""
        noise = self.null_space([ALL] * (self.method.xpic_order + 1))
        noise[self.body.mask(INNER)] = 0.0
        self.points.v -= noise

    def null_space(self, groups: Sequence[Group], level: int = 0) -> Floats:
        """The part ``(I - Pi)^m v`` of the velocities that the grid does not see, shape ``(n, d)``.

        ``Pi`` takes velocities from points to nodes and back.

        Parameters
        ----------
        groups : sequence of Group
            The points that count before each of the m passes, and after the last one. Each group
            must extend three cells beyond the next, so that nodal sums are complete. The result
            has no meaning outside the last group.
        level : int
            The coarsest level for whose steps the result is needed (``subcycling.py``).
        """
        part = self.points.v.copy()
        for number, (before, after) in enumerate(pairwise(groups)):
            # what is left after the first pass is zero where the velocity is prescribed
            P = np.zeros_like(self.V)
            self.body.scatter(before, part, P)
            V = self.velocity_of(P, level, share=1.0 if number == 0 else 0.0)
            self.body.gather(after, V, -1.0, part)
        return part

    def velocity_of(self, P: Floats, level: int = 0, share: float = 1.0) -> Floats:
        """Nodal velocity of a momentum, shape ``(size, d)``, with the masses of the last step.

        Parameters
        ----------
        P : ndarray, shape ``(size, d)``
            This rank's sums; they are completed in place.
        level : int
            The coarsest level for whose steps the result is needed (``subcycling.py``).
        share : float
            Prescribed components take this fraction of their value.
        """
        V = np.zeros_like(P)
        self.nodes.complete(level, P)
        self.stages.solve_velocity(level, P, V, share)
        return V

    # --- results ----------------------------------------------------------------------------

    @property
    def points(self) -> MaterialPoints:
        """Points of this rank, in the order of the sweeps."""
        return self.body.points

    @property
    def time(self) -> float:
        """Present time."""
        return self.clock.time

    @property
    def steps(self) -> int:
        """Steps of the finest level so far."""
        return self.clock.steps

    @property
    def dt(self) -> float:
        """Time step of the finest level."""
        return self.clock.dt

    def energies(self, group: Group = ALL, exact: bool = True) -> Floats:
        """Kinetic and strain energy, mass and momentum of a group now, shape ``(3 + d,)``.

        Of this rank's points only, at a time that all levels have reached; collective. Brings
        ``work_now`` to the same time. See ``present_velocities`` for ``exact``.

        Raises
        ------
        ValueError
            The levels have not all reached the present time.
        """
        if not self.clock.synchronous():
            raise ValueError(
                f"levels stand at different times after {self.steps} steps; energies are defined "
                f"every {2**self.top} steps"
            )
        if exact and not self.clock.velocities_are_present():
            self.refresh()
        v, self.work_now = present_velocities(self.stages, exact)
        return sum_energies(self.body, v, group)

    def tally(self, group: Group = ALL, exact: bool = True) -> Energies:
        """Energies of a group in mechanical units, without interface work; see ``energies``."""
        kinetic, strain, mass, *momentum = self.energies(group, exact).tolist()
        return Energies(
            kinetic=kinetic,
            potential=strain,
            external_work=self.work_now,
            interface_work=0.0,
            dissipated=self.dissipation(group),
            mass=mass,
            momentum=tuple(momentum),
        )

    def dissipation(self, group: Group = ALL) -> float:
        """Energy that the law has dissipated in a group, and damping everywhere, on this rank."""
        return self.body.dissipation(group) + self.work.damped

    def strain_energy(self, group: Group = ALL) -> Floats:
        """Strain energy and mass of a group now, of this rank's points only, shape ``(2,)``."""
        return strain_energy(self.body, group)

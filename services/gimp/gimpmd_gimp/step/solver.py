"""One step of GIMP on nested levels: points to nodes, field solve, nodes to points.

Levels step by force splitting (r-RESPA): forces of a level's points kick with the level's own
step, ``dt_l = 2^(top - l) dt``; all levels share one composite basis, so momentum is exact and
the whole is a symplectic map as long as points stay in their cells. ``step`` advances the finest
level once, and the coarser ones whenever their turn comes (``subcycling.py``).

In the *reference configuration* (total Lagrangian) points stay on the grid where they stand at
rest: stencils, nodal mass and everybody's place are found once, and nodes carry displacements. No
point crosses a cell, so the whole is a symplectic map for finite laws and any motion too. In the
*current* one points move over the grid.

Points that another code moves (the group "inner") take part in the nodal sums but are not
deformed or moved here. Where they end inside the body (the group "rim", their last layer) nodes
are half filled, and stress on one side of them would push like a cut: these nodes get no internal
force.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, groupby, pairwise
from typing import Literal

import numpy as np

from gimpmd_gimp.boundary.absorbing import Absorbing, absorb, make_dashpots
from gimpmd_gimp.boundary.conditions import (
    BodyForce,
    Displaced,
    Driven,
    NodalForces,
    Pace,
    Traction,
    hold_nodes,
    make_loads,
)
from gimpmd_gimp.fracture.contact import Contact
from gimpmd_gimp.fracture.cracks import Cracks, fill_detours, near_cracks
from gimpmd_gimp.grid.constraints import Slaves
from gimpmd_gimp.grid.halo import Halo
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.laws import InelasticLaw, Law
from gimpmd_gimp.laws.law import history_size, is_inelastic
from gimpmd_gimp.points.distribution import in_blocks, settle, sort
from gimpmd_gimp.points.material_points import Configuration, MaterialPoints
from gimpmd_gimp.points.splitting import change_levels, find_changes, near_rims
from gimpmd_gimp.step import subcycling
from gimpmd_gimp.step.dispersion import Dispersion, consistent_mass
from gimpmd_gimp.sweeps import kernels
from gimpmd_gimp.sweeps.threads import CACHED, Stripes, Team, make_stripes
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.errors import BackendError

MASS_FLOOR = 1e-12
"""Nodes with less than this fraction of a full node's mass have no velocity."""

Integrator = Literal["usavg", "musl", "usl", "usf"]
Interpolation = Literal["linear", "ugimp", "cpgimp", "bspline"]


@dataclass(frozen=True)
class Region:
    """Where velocities decay, or are taken from the grid in part.

    Attributes
    ----------
    box : bounds of reference positions along each axis, or None for everywhere.
    rate : rate of decay (1 / time).
    flip : share of FLIP in the update of velocities; the rest is PIC.
    """

    box: tuple[tuple[float, float], ...] | None = None
    rate: float = 0.0
    flip: float = 1.0


@dataclass(frozen=True)
class Scheme:
    """How a step is taken.

    Attributes
    ----------
    integrator : when points deform: half before and half after the kick, with positions at the
        midpoint (``usavg``); after it with the projected new momentum (``musl``) or with the
        advanced nodal velocity (``usl``); before it (``usf``).
    interpolation : weights of the points; ``cpgimp`` stretches their domains with F, which has no
        meaning in the reference configuration.
    xpic_order, xpic_every : the XPIC filter of FLIP's null space and how often it acts (0: never).
        It never does in the reference configuration: what weights that stay the same cannot see
        now they never will.
    damping : regions of decay and of PIC.
    configuration : where points stand on the grid.
    dispersion : strength beta of the dispersion correction (``dispersion.py``), 0 for none; with
        MUSL in the reference configuration, and weights of hats that points average or not.

    Raises
    ------
    ValueError
        If these do not go together.
    """

    integrator: Integrator = "usavg"
    interpolation: Interpolation = "ugimp"
    xpic_order: int = 5
    xpic_every: int = 20
    damping: tuple[Region, ...] = ()
    configuration: Configuration = "current"
    dispersion: float = 0.0

    def __post_init__(self) -> None:
        fixed = self.configuration == "reference"
        if fixed and self.interpolation == "cpgimp":
            raise ValueError("points do not stretch in the reference configuration: take ugimp")
        if self.dispersion < 0.0:
            raise ValueError(f"the dispersion correction {self.dispersion:g} is negative")
        fits = fixed and self.integrator == "musl" and self.interpolation in ("ugimp", "linear")
        if self.dispersion > 0.0 and not fits:
            raise ValueError(
                "the dispersion correction needs the reference configuration, MUSL, and ugimp or "
                f"linear; this is {self.configuration}, {self.integrator}, {self.interpolation}"
            )


@dataclass(frozen=True)
class Active:
    """Nodes that take part when a level is the coarsest that steps.

    Attributes
    ----------
    nodes : ndarray of int64
        Nodes of the basis that are solved: their sums are whole.
    cleared : ndarray of int64
        All nodes that get sums, slaves and their masters included.
    unsolved : ndarray of int64
        Those among them that are not solved.
    slaves : Slaves
    halo : Halo
    """

    nodes: Ints
    cleared: Ints
    unsolved: Ints
    slaves: Slaves
    halo: Halo


@dataclass(frozen=True)
class Sweep:
    """A pass over the points of a group.

    Attributes
    ----------
    group : name of the group.
    work : serves the points ``first`` to ``last`` of its stripes.
    to_nodes : whether it writes to nodes, or to these points alone.
    """

    group: str
    work: Callable[[Stripes, int, int], object]
    to_nodes: bool


class Solver:
    """GIMP on the levels of a mesh.

    Parameters
    ----------
    mesh : Mesh
    points : MaterialPoints
        Any points of the body; they go to the ranks that hold their place.
    law : Law
    scheme : Scheme
    dt : float
        Time step of the finest level.
    tractions, driven, absorbing : sequence
        Conditions on faces.
    body_force : callable, optional
        Acceleration ``b(X, t)``, shape ``(n, d)``, at reference positions.
    cracks : Cracks, optional
        Those for which the mesh has twins.
    groups : mapping, optional
        Named groups of points, as masks. The group "inner" follows another code; nodes that its
        part "rim" touches bear no internal force.
    booked : callable, optional
        Which positions count in the work of the faces; all if left out.
    nodal_forces : NodalForces, optional
        What else pushes nodes of the finest level, whenever that level kicks. May be set later.
    threads : int
        How many share the sweeps.

    Attributes
    ----------
    M : ndarray, shape ``(size,)``
        Nodal mass.
    V : ndarray, shape ``(size, d)``
        Nodal velocity after the last step: the points' new momentum, projected.
    work_now : float
        External work at the time of the last ``energies``.
    external_work, interface_work : float
        Work of loads and driven faces on the body, and of the inner points on the rest, so far.
    fixed : bool
        Whether points stay on the grid where they stand in the reference configuration.
    contact : Contact or None
        Where faces of cracks touch, and the work of their friction.
    kick_sums : ndarray, shape ``(1 + d,)``
        Kinetic energy and momentum of this rank's points at the time of the last kick of all
        levels together, in the middle of it: with MUSL the beginning of that step, where they are
        exact.
    clock, span : ndarray, shape ``(top + 1,)``
        Time at which each level's velocities stand, and length of its last kick.
    """

    def __init__(
        self,
        mesh: Mesh,
        points: MaterialPoints,
        law: Law,
        scheme: Scheme,
        dt: float,
        *,
        tractions: Sequence[Traction] = (),
        driven: Sequence[Driven | Displaced] = (),
        absorbing: Sequence[Absorbing] = (),
        body_force: BodyForce | None = None,
        cracks: Cracks | None = None,
        groups: Mapping[str, Bools] | None = None,
        booked: Callable[[Floats], Bools] | None = None,
        nodal_forces: NodalForces | None = None,
        threads: int = 1,
    ) -> None:
        self.mesh, self.hierarchy, self.law, self.scheme = mesh, mesh.hierarchy, law, scheme
        self.dt, self.top = dt, mesh.hierarchy.top
        self._stretch = scheme.interpolation == "cpgimp"
        self.fixed = scheme.configuration == "reference"
        self.time, self.steps = 0.0, 0
        self.external_work, self.interface_work, self.work_now = 0.0, 0.0, 0.0
        self._tractions, self._body_force, self.cracks = tuple(tractions), body_force, cracks
        self._absorbing, self.nodal_forces = tuple(absorbing), nodal_forces
        self._loaded = bool(tractions or driven or absorbing) or body_force is not None
        self._team = Team(threads)
        self._bits: dict[str, int] = {}
        for name, mask in (groups or {}).items():
            self._bits[name] = 1 << len(self._bits)
            points.flags[mask] |= self._bits[name]

        if points.history.shape[1] != history_size(law):
            raise ValueError(
                f"{law.name} has {history_size(law)} history variables, but the points have "
                f"{points.history.shape[1]}"
            )
        d, size = mesh.hierarchy.dim, mesh.size
        self.mass_floor = MASS_FLOOR * law.density * self.hierarchy.edge(self.top) ** d
        self._axes = (0,) * d
        self.M, self._M_inner, self._M_rim = (np.zeros(size) for _ in range(3))
        self.V, self._U, self._P = (np.zeros((size, d)) for _ in range(3))
        self._J, self._J_inner, self._J_loads = (np.zeros((size, d)) for _ in range(3))
        self._C = np.zeros((size if absorbing else 0, d))
        self.active = [self._make_active(level) for level in range(self.top + 1)]
        self._held = hold_nodes(mesh, driven, [self._pace(one) for one in range(self.top + 1)])
        self._kicked = np.zeros(self.top + 1, dtype=np.bool_)
        self.contact: Contact | None = None
        if cracks is not None and cracks.friction is not None:
            nodes = [active.nodes for active in self.active]
            self.contact = Contact(mesh, cracks, cracks.friction, nodes)
        self._mid = np.zeros((size, d))
        inside = np.ones(size, np.bool_) if booked is None else booked(mesh.positions())
        self._booked = mesh.counts * inside
        self.clock = np.zeros(self.top + 1)
        self.span = np.full(self.top + 1, self.dt)

        self.kick_sums = np.zeros(1 + d)
        self._left: list[Sweep] = []  # of the present step
        self._prepared = False

        self.nominal_half = self._largest(float(points.half.max(initial=0.0)))
        self.arrange(settle(mesh, points, scheme.configuration))
        if self._changes_due():
            self.regroup()
        if is_inelastic(law):  # the initial strain may be beyond the elastic range
            self._run(self._updating(law, "all"))
        self.project_anew()

    # --- the step ---------------------------------------------------------------------------

    def step(self) -> None:
        """Advance the finest level by one step, and coarser ones when it is their turn."""
        self.start_step()
        self.end_step()

    def start_step(self) -> None:
        """Take a step as far as its nodal velocities ``V``, for which others may wait.

        With MUSL the points deform after that: look at them after ``end_step``.
        """
        self.end_step()
        level = subcycling.steppers(self.steps, self.top)
        self.refresh(level)
        self._start_kick(range(level, self.top + 1))
        if self.scheme.integrator == "usavg":
            self._usavg(level)
        elif self.scheme.integrator == "musl":
            self._left = self._musl(level)
        elif self.scheme.integrator == "usl":
            self._usl(level)
        else:
            self._usf(level)
        self.time += self.dt
        self.steps += 1
        if level == 0 and self._filter_due():
            noise = self.null_space(["all"] * (self.scheme.xpic_order + 1))
            noise[self.mask("inner")] = 0.0
            self.points.v -= noise

    def end_step(self) -> None:
        """Do what ``start_step`` has left."""
        left, self._left = self._left, []
        self._run(*left)

    def prepare(self) -> None:
        """Sum what is known of the next step: the impulse of stress, where stencils stay.

        Worth it where others wait for ``start_step``; exact energies cost as much once more.
        """
        if self.fixed and self.scheme.integrator == "musl" and not self._prepared:
            level = subcycling.steppers(self.steps, self.top)
            span = np.array([self._next_span(one) for one in range(self.top + 1)])
            self._sum_stress(level, range(level, self.top + 1), span)
            self._prepared = True

    def _musl(self, level: int) -> list[Sweep]:
        """Modified update stress last: deform with the projected new momentum.

        Returns the sweeps that deform.
        """
        levels = range(level, self.top + 1)
        self._sum_mass(level)
        self._push(level, levels, self.time, self.span)
        self._book(level)
        self._kick(level, levels)
        self._velocity(level, self._P)
        self._book(level)
        return self._deforming(levels, 1.0)

    def _usl(self, level: int) -> None:
        """Update stress last: deform with the old nodal velocity advanced by the kick."""
        levels = range(level, self.top + 1)
        self.project_anew(level)
        self._push(level, levels, self.time, self.span)
        self._book(level)
        self._kick(level, levels, 1.0, self._deforming(levels, 1.0))
        self._book(level)

    def _usf(self, level: int) -> None:
        """Update stress first: deform with the old nodal velocity, then kick and move."""
        levels = range(level, self.top + 1)
        self.project_anew(level)
        before = self._deforming(levels, 1.0, move=False)
        self._push(level, levels, self.time, self.span, before)
        self._book(level)
        self._kick(level, levels, 1.0, self._moving(levels))
        self._book(level)

    def _usavg(self, level: int) -> None:
        """Update stress averaged: half a step with the old velocity, half with the new one.

        Positions and loads are taken at the midpoint. Coarser levels kick first and deform over
        their whole step at once (position Verlet inside velocity Verlet).
        """
        top = self.top
        if level < top:
            coarser = range(level, top)
            self._sum_mass(level)
            self._push(level, coarser, self.time, self.span)
            self._book(level)
            self._kick(level, coarser)
            self._velocity(level, self._P)
            self._book(level)
            self._run(*self._deforming(coarser, 1.0))
        else:
            self.project_anew(level)
        half = self._deforming([top], 0.5, move=False)
        self._push(top, [top], self.time + 0.5 * self.dt, self.span, half)
        self._book(top)
        self._kick(top, [top], 0.5, self._moving([top]))
        self._velocity(top, self._P)
        self._book(top)
        self._run(*half)

    # --- parts of a step --------------------------------------------------------------------

    def dt_of(self, level: int) -> float:
        """Time step of a level."""
        return self.dt * 2 ** (self.top - level)

    def project_anew(self, level: int = 0) -> None:
        """Nodal mass and velocity of the points at their stencils (paper Eq. 16)."""
        active, group, p, M = self.active[level], f"summed {level}", self.points, self.M[:, None]
        if self.fixed:  # and so is the mass
            self._clear(active, self._P)
            self.scatter(group, p.v, self._P)
            self._complete(active, self._P)
        else:
            self._clear(active, M, self._P)
            self._scatter(kernels.scatter_momentum, group, p.mass, p.v, self.M, self._P)
            self._complete(active, M, self._P)
        self._solve(level, self._P, self.V)

    def _sum_mass(self, level: int) -> None:
        """Nodal mass, and the nodal velocity too where forces depend on it."""
        if self._damped is not None or self._absorbing or self.contact is not None:
            self.project_anew(level)
        elif not self.fixed:
            self._sum_mass_of(f"summed {level}", level, self.M)

    def _sum_mass_of(self, group: str, level: int, M: Floats) -> None:
        """Nodal mass of a group of points (paper section 3.1)."""
        active = self.active[level]
        self._clear(active, M[:, None])
        self._scatter(kernels.scatter_mass, group, self.points.mass, M)
        self._complete(active, M[:, None])

    def _start_kick(self, levels: Sequence[int]) -> None:
        """Note which levels are kicked, and how long."""
        self._kicked[:] = False
        for one in levels:
            self.span[one] = self._next_span(one)

    def _next_span(self, level: int) -> float:
        """Length of a level's next kick: to its next half, or whole, step."""
        half_first = self.steps == 0 and not self._whole(level)
        return self.dt_of(level) * (0.5 if half_first else 1.0)

    def _push(
        self,
        level: int,
        levels: Sequence[int],
        load_time: float,
        span: Floats,
        before: Sequence[Sweep] = (),
    ) -> None:
        """Change ``U`` of the nodal velocity by what acts on some levels, each over its span.

        Forces are summed after the sweeps ``before``, on the way if they go over the same points.
        """
        p, active = self.points, self.active[level]
        others = [self._J_loads] if self._loaded else []
        follows = "inner" in self._bits and self.top in levels
        if follows:
            others.append(self._J_inner)
        dashpots = [self._C] if self._absorbing else []
        if not self._prepared:
            self._sum_stress(level, levels, span, before)
        self._prepared = False
        self._clear(active, *others, *dashpots)
        for one in levels:
            if one == self.top and self.nodal_forces is not None:
                self.nodal_forces.add(float(span[one]), self._J)
            self._load(one, load_time, span[one])
            for dashpot in self._dashpots:
                if dashpot.level == one:
                    dashpot.add(p, self._stretch, span[one], self._C)
        if follows:
            self._run(*self._internal("inner", span[self.top], self._J_inner))
            if not self.fixed:
                self._sum_inner_mass(level)
        self._complete(active, self._J, *others, *dashpots)

        def solve(nodes: Ints) -> None:
            if follows and "rim" in self._bits:
                for internal in (self._J, self._J_inner):
                    kernels.clear_touched(self._axes, nodes, self._M_rim, internal)
            for other in others:
                kernels.add(self._axes, nodes, other, 1.0, self._J)
            kernels.divide(self._axes, nodes, self._J, self.M, self.mass_floor, self._U)

        self._team.solve(solve, active.nodes)
        kernels.clear(self._axes, active.unsolved, self._U)
        if self._absorbing:
            arrays = (self._C, self.M, self.mass_floor, self.V, self._U, self._J_loads)
            absorb(active.nodes, *arrays)
        self._hold_change(levels, span)
        if self.contact is not None:
            finest = max(levels)
            self.contact.act(self, level, finest, span[finest], self._U)
        if self._dispersion is not None:
            self._dispersion.correct_change(level, active.halo, self._team, self._U)
            self._hold_change(levels, span)
        active.slaves.prolong(self._U)
        if follows:
            kernels.inertia(self._axes, active.nodes, self._M_inner, self._U, self._J_inner)

    def _sum_stress(
        self,
        level: int,
        levels: Sequence[int],
        span: Floats,
        before: Sequence[Sweep] = (),
    ) -> None:
        """Impulse of the stress on some levels, each over its span, to ``J``; sums stay parts."""
        self._clear(self.active[level], self._J)
        inside = [self._internal(f"level {one}", span[one], self._J) for one in levels]
        self._run(*before, *chain.from_iterable(inside))

    def _sum_inner_mass(self, level: int) -> None:
        """Nodal mass of the inner points, and of their rim."""
        for group, M in (("inner", self._M_inner), ("rim", self._M_rim)):
            if group in self._bits:
                self._sum_mass_of(group, level, M)

    def _load(self, level: int, time: float, span: float) -> None:
        """Add the impulse of tractions and body forces on a level to ``J_loads``."""
        p = self.points
        for load in self._loads:
            if load.level == level:
                load.add(p, self._stretch, span * load.factor(time), self._J_loads)
        if self._body_force is not None:
            b = span * self._body_force(p.reference, time)
            self._scatter(kernels.scatter_vector, f"level {level}", p.mass, b, self._J_loads)

    def _add_loads(self, levels: Sequence[int], time: float, span: Floats) -> None:
        """Impulse of tractions and body forces on some levels, each over its span, alone."""
        active = self.active[levels[0]]
        self._clear(active, self._J_loads)
        for one in levels:
            self._load(one, time, span[one])
        self._complete(active, self._J_loads)

    def _hold_change(self, levels: Sequence[int], span: Floats) -> None:
        """Driven nodes change as prescribed; what holds them counts as a load."""
        for held in self._held:
            if held.level in levels:
                clock, place = self.clock[held.level], (held.nodes, held.component)
                change = held.velocity(clock + span[held.level]) - held.velocity(clock)
                self._J_loads[place] += self.M[held.nodes] * (change - self._U[place])
                self._U[place] = change

    def _kick(
        self, level: int, levels: Sequence[int], advance: float = 0.0, along: Sequence[Sweep] = ()
    ) -> None:
        """Kick the points by ``U`` (FLIP) and project their new momentum to ``P``.

        ``V += advance U`` before, for the sweeps ``along`` the way; they do not read ``P``.
        """
        # the first kick of velocities at half steps goes on from whole ones
        share = 0.5 if self.steps or self._whole(levels[0]) else 0.0
        for one in levels:
            self.clock[one] += self.span[one]
            self._kicked[one] = True
        if self._damped is not None:
            self._mid[:] = self.V + self._U
        if advance:
            self._advance(level, advance)
        p, active = self.points, self.active[level]
        self._clear(active, self._P)
        sums = np.zeros((self._stripe.max(initial=0) + 1, 1 + p.dim))
        own, others = f"own {levels[0]} {levels[-1]}", f"others {level} {levels[0]} {levels[-1]}"
        arrays = (self._P, share, self._stripe, sums)
        point = (self._U, p.mass, p.v)
        kick = self._sweep(kernels.kick, own, *point, p.dv, *arrays, to_nodes=True)
        self._run(kick, *along)
        self._scatter(kernels.kick, others, *point, self._later, *arrays)
        if level == 0:
            self.kick_sums = np.sum(sums, axis=0)
            self._check_energy()
        if self._damped is not None:
            self._damp(active, own, others, *self._damped)
        self._complete(active, self._P)
        if self.contact is not None:
            self.contact.commit(self._P, self.M)

    def _check_energy(self) -> None:
        """Stop a run that has blown up where no point can leave the grid to tell so."""
        if self.fixed and self._largest(float(not np.isfinite(self.kick_sums[0]))) > 0.0:
            raise BackendError(
                f"GIMP: the kinetic energy is no number at t = {self.time:g}; the run is unstable: "
                "reduce time.md_steps, time.step or the load"
            )

    def _damp(self, active: Active, own: str, others: str, rate: Floats, flip: Floats) -> None:
        """Let velocities decay, or take a part of them from the grid (PIC)."""
        p = self.points
        grid = np.zeros_like(p.v)
        self.gather(own, self._mid, 1.0, grid)
        rows = self.stripes(own).order
        decay = np.exp(-rate[rows] * self.span[p.level[rows]])[:, None]
        share = flip[rows, None]
        p.v[rows] = decay * (share * p.v[rows] + (1.0 - share) * grid[rows])
        self._clear(active, self._P)
        for group in (own, others):
            self.scatter(group, p.v, self._P)

    def _velocity(self, level: int, P: Floats) -> None:
        """Nodal velocity of a momentum, to ``V``; driven components as prescribed."""
        self._solve(level, P, self.V)

    def _solve(self, level: int, P: Floats, V: Floats, held: float = 1.0) -> None:
        active, axes = self.active[level], self._axes
        self._team.solve(
            lambda nodes: kernels.divide(axes, nodes, P, self.M, self.mass_floor, V), active.nodes
        )
        self._hold(V, held)
        if self.contact is not None:
            self.contact.share(V, self.M, level)
        if self._dispersion is not None:
            self._dispersion.correct_velocity(level, active.halo, self._team, V)
            self._hold(V, held)
        active.slaves.prolong(V)

    def _hold(self, V: Floats, share: float) -> None:
        for one in self._held:
            one.hold(V, self.clock[one.level], self._kicked[one.level], share)

    def _advance(self, level: int, share: float) -> None:
        """``V += share U``."""
        active, axes = self.active[level], self._axes
        self._team.solve(
            lambda nodes: kernels.add(axes, nodes, self._U, share, self.V), active.nodes
        )
        for one in self._held:
            if one.during is not None:
                one.hold(self.V, self.clock[one.level], True)
        active.slaves.prolong(self.V)

    def _deforming(self, levels: Sequence[int], share: float, move: bool = True) -> list[Sweep]:
        """Sweeps that deform, and move, points with ``V`` over a share of their steps."""
        steps = [(f"moved {one}", share * self.dt_of(one)) for one in levels]
        sweeps = [self._motion(group, self.V, dt, dt if move else 0.0) for group, dt in steps]
        return list(chain.from_iterable(sweeps))

    def _moving(self, levels: Sequence[int]) -> list[Sweep]:
        """Sweeps that move points with ``V`` over their steps."""
        gather, x = kernels.gather_vector, self.points.x
        return [self._sweep(gather, f"moved {one}", self.V, self.dt_of(one), x) for one in levels]

    def _book(self, level: int) -> None:
        """Half of the work over a kick, with the present nodal velocity: once before, once after.

        Projected velocities stay finite on nodes that carry load but hardly any mass.
        """
        self.external_work += 0.5 * self._work_of_loads(level)
        if "inner" in self._bits:
            self.interface_work += 0.5 * self._work(level, self._J_inner, self.mesh.counts)

    def _work_of_loads(self, level: int) -> float:
        """Work of the impulse ``J_loads`` with the present nodal velocity."""
        if not self._loaded:
            return 0.0
        return self._work(level, self._J_loads, self._booked)

    def _work(self, level: int, J: Floats, counts: Floats) -> float:
        """Work of an impulse with the present nodal velocity, over nodes that count."""
        axes = self._axes
        return sum(
            self._team.solve(
                lambda nodes: float(kernels.work(axes, nodes, J, self.V, counts)),
                self.active[level].nodes,
            )
        )

    # --- sweeps -----------------------------------------------------------------------------

    def scatter(self, group: str, q: Floats, Q: Floats) -> None:
        """Add ``S_ip m_p q_p`` of a group to ``Q``; sums stay parts until ``complete``."""
        self._scatter(kernels.scatter_vector, group, self.points.mass, q, Q)

    def gather(self, group: str, Q: Floats, factor: float, q: Floats) -> None:
        """Add ``factor`` times the interpolated ``Q`` to a group's rows of ``q`` (paper Eq. 5)."""
        self._run(self._sweep(kernels.gather_vector, group, Q, factor, q))

    def deform(self, group: str, V: Floats, dt: float, x_step: float) -> None:
        """Deform a group with ``V`` over ``dt`` and shift it by ``x_step`` of it."""
        self._run(*self._motion(group, V, dt, x_step))

    def solve(self, P: Floats, level: int = 0, held: float = 1.0) -> Floats:
        """Nodal velocity of a momentum, which is completed in place, shape ``(size, d)``.

        Nodal masses are those of the last step.

        Parameters
        ----------
        level : int
            The coarsest level for whose steps the result is wanted (``subcycling.py``).
        held : float
            Driven components are this share of what is prescribed.
        """
        V, active = np.zeros_like(self.V), self.active[level]
        self._complete(active, P)
        self._solve(level, P, V, held)
        return V

    def null_space(self, groups: Sequence[str], level: int = 0) -> Floats:
        """The part ``(I - Pi)^m v`` of the velocities that the grid does not see, shape ``(n, d)``.

        ``Pi`` takes points to nodes and back. Taken out of the velocity as a whole this is the
        XPIC filter of order m (Hammerquist and Nairn 2017).

        Parameters
        ----------
        groups : sequence of str
            The group of points that counts before each of the m passes, and after the last. Each
            must reach three cells beyond the next, so that nodal sums are whole; outside the last
            one the result has no meaning.
        """
        part = self.points.v.copy()
        for number, (before, after) in enumerate(pairwise(groups)):
            # what is left after the first pass vanishes where the velocity is prescribed
            P = np.zeros_like(self.V)
            self.scatter(before, part, P)
            V = self.solve(P, level, held=1.0 if number == 0 else 0.0)
            self.gather(after, V, -1.0, part)
        return part

    def energies(self, group: str = "all", exact: bool = True) -> Floats:
        """Kinetic and strain energy, mass and momentum of a group now, shape ``(3 + d,)``.

        Of this rank's points alone, at a time at which all levels stand; collective. Brings
        ``work_now``, the work of the loads, to the same time.

        Parameters
        ----------
        exact : bool
            Bring velocities that stand half a step back to the present by a part of the next
            kick: energy, momentum and work are then those of the symplectic scheme, at the cost of
            half a step. Else by as much of the last kick, which errs by second order in the step
            and leaves the state of the sweeps alone; work of driven faces then stays behind.
        """
        if not self.synchronous():
            raise ValueError(f"levels do not stand at the same time after {self.steps} steps")
        p, d = self.points, self.hierarchy.dim
        whole = all(self._whole(level) for level in range(self.top + 1))
        self.work_now = self.external_work
        if whole or not self.steps:
            self._later[:] = p.v
        elif not exact:
            self._add_loads(range(self.top + 1), self.time, self.time - self.clock)
            self.work_now += self._work_of_loads(0)
            lag = np.array([self.lag(level) for level in range(self.top + 1)])
            np.multiply(lag[p.level][:, None], p.dv, out=self._later)
            self._later += p.v
        else:
            self.refresh()
            p = self.points
            self._later[:] = p.v
            self._bring_to_present(self._later, 1.0)
            self.work_now += self._work_of_loads(0)
        stripes = self.stripes(group)
        chosen = stripes.order, 0, stripes.order.size
        self.law.energy(*chosen, p.F, p.history, self._density)

        def part(first: int, last: int) -> Floats:
            sums = np.zeros(3 + d)
            kernels.sum_energies(
                stripes.index, first, last, p.mass, self._later, p.volume, self._density, sums
            )
            return sums

        return np.sum(self._team.gather(part, stripes), axis=0)

    def strain_energy(self, group: str = "all") -> Floats:
        """Strain energy and mass of a group now, of this rank's points alone, shape ``(2,)``.

        With MUSL, before a step, it is that at the time of ``kick_sums`` after it.
        """
        stripes, p = self.stripes(group), self.points
        self._team.gather(
            lambda first, last: self.law.energy(
                stripes.order, first, last, p.F, p.history, self._density
            ),
            stripes,
        )
        energy = p.volume[stripes.order] @ self._density[stripes.order]
        return np.array([energy, p.mass[stripes.order].sum()])

    def dissipation(self, group: str = "all") -> float:
        """Energy that the law of a group has dissipated so far, of this rank's points only."""
        law, p = self.law, self.points
        if not is_inelastic(law):
            return 0.0
        order = self.stripes(group).order
        density = np.zeros(p.count)
        law.dissipation(order, 0, order.size, p.history, density)
        return float(p.volume[order] @ density[order])

    def stress(self, group: str = "all") -> Floats:
        """Kirchhoff stress of a group now, in its rows of ``(n, d, d)``."""
        order, p = self.stripes(group).order, self.points
        self._team.gather(
            lambda first, last: self.law.stress(order, first, last, p.F, p.history, self._stress),
            self.stripes(group),
        )
        return self._stress

    def _internal(self, group: str, span: float, J: Floats) -> list[Sweep]:
        """Sweeps that add the impulse of a group's stress over a span to ``J``."""
        p, law = self.points, self.law
        nominal = self.fixed and law.finite

        def stress(stripes: Stripes, first: int, last: int) -> None:
            chosen = (stripes.order, first, last)
            law.stress(*chosen, p.F, p.history, self._stress)
            if nominal:
                kernels.nominal(self._axes, *chosen, p.F, self._stress)

        arrays = (span, p.volume, self._stress, J)
        force = self._sweep(kernels.scatter_force, group, *arrays, to_nodes=True)
        return [Sweep(group, stress, False), force]

    def _motion(self, group: str, V: Floats, dt: float, x_step: float) -> list[Sweep]:
        """Sweeps of ``deform``: they advance F, then the history variables that follow from it."""
        p, law = self.points, self.law
        chained = law.finite and not self.fixed
        motion = self._sweep(kernels.gather_motion, group, V, dt, chained, p.F, x_step, p.x)
        return [motion, self._updating(law, group)] if is_inelastic(law) else [motion]

    def _updating(self, law: InelasticLaw, group: str) -> Sweep:
        """Sweep that advances the history variables of a group to the present F."""
        p = self.points

        def update(stripes: Stripes, first: int, last: int) -> None:
            law.update(stripes.order, first, last, p.F, p.history)

        return Sweep(group, update, False)

    def _sweep(
        self, kernel: Callable[..., None], group: str, *arrays: object, to_nodes: bool = False
    ) -> Sweep:
        """Sweep of a kernel over the points of a group with their stencils."""
        s = self.stencils

        def work(stripes: Stripes, first: int, last: int) -> None:
            kernel(stripes.index, first, last, s, *arrays)

        return Sweep(group, work, to_nodes)

    def _scatter(self, kernel: Callable[..., None], group: str, *arrays: object) -> None:
        """Run a sweep that writes to nodes."""
        self._run(self._sweep(kernel, group, *arrays, to_nodes=True))

    def _run(self, *sweeps: Sweep) -> None:
        """Run sweeps, of which none reads nodes that one before it writes.

        Those in a row that go over the same points form a chain: all of them serve some points
        while these are in the cache, then the next ones, so that memory is read once.
        """
        for _, links in groupby(sweeps, key=lambda sweep: id(self.stripes(sweep.group))):
            self._run_chain(list(links))

    def _run_chain(self, links: Sequence[Sweep]) -> None:
        stripes = self.stripes(links[0].group)

        piece = CACHED if len(links) > 1 else max(stripes.order.size, 1)

        def part(first: int, last: int) -> None:
            for start in range(first, last, piece):
                for link in links:
                    link.work(stripes, start, min(start + piece, last))

        share = self._team.scatter if any(link.to_nodes for link in links) else self._team.gather
        share(part, stripes)

    def _clear(self, active: Active, *sums: Floats) -> None:
        def clear(nodes: Ints) -> None:
            for one in sums:
                kernels.clear((0,) * one.shape[1], nodes, one)

        self._team.solve(clear, active.cleared)

    def _complete(self, active: Active, *sums: Floats) -> None:
        """Sums on slaves go to their masters, sums of all ranks together."""
        for one in sums:
            active.slaves.restrict(one)
        active.halo.complete(*sums)

    # --- points: groups, order, stencils ----------------------------------------------------

    def add_group(self, name: str, mask: Bools) -> None:
        """Name a group of points, by a mask over them as they stand, to sweep over it alone."""
        self._bits[name] = 1 << len(self._bits)
        self.points.flags[mask] |= np.int32(self._bits[name])

    def mask(self, group: str) -> Bools:
        """Which points belong to a group, shape ``(n,)``.

        Named groups apart there are: "all"; "level l", of a level and not inner; "moved l", of a
        rate and not inner; "fresh l", of a rate of at least l; "summed l", those that count when
        level l is the coarsest that steps; "own l m", of levels l to m; "others k l m", the rest
        of "summed k".
        """
        p = self.points
        if group in self._bits:
            return (p.flags & np.int32(self._bits[group])) != 0
        word, *numbers = group.split()
        number = [int(n) for n in numbers]
        if word == "all":
            return np.ones(p.count, dtype=np.bool_)
        if word == "inner":
            return np.zeros(p.count, dtype=np.bool_)
        if word == "fresh":
            return p.rate >= number[0]
        if word == "summed":
            return self._reach >= number[0]
        own = (p.level >= number[-2 % len(number)]) & (p.level <= number[-1])
        if word == "own":
            return own
        if word == "others":
            return (self._reach >= number[0]) & ~own
        return ((p.level if word == "level" else p.rate) == number[0]) & ~self.mask("inner")

    def stripes(self, group: str) -> Stripes:
        """Points of a group, as sweeps take them; valid until points are sorted again."""
        if group not in self._stripes:
            mask = self.mask(group)
            if group != "all" and mask.all():  # as on a single level: hold one order of all points
                self._stripes[group] = self.stripes("all")
            else:
                self._stripes[group] = make_stripes(np.flatnonzero(mask), self._stripe)
        return self._stripes[group]

    def refresh(self, level: int = 0) -> None:
        """Stencils of the points that the last steps moved; points that drifted are sorted anew.

        Raises
        ------
        BackendError
            A point has left the background grid.
        """
        if self.fixed:
            return
        drifted = self._fill(f"fresh {level}")
        if level == 0 and (drifted or (self._may_change() and self._changes_due())):
            self.regroup()

    def regroup(self) -> None:
        """Let points change level and rank, sort them, and compute their stencils; collective.

        Levels keep their velocities at different times, so points change level with velocities of
        the present: momentum and energy there are those before the change. In the reference
        configuration all are at home from the start.
        """
        if self.fixed and self.steps:
            return
        configuration = self.scheme.configuration
        if not self._changes_due():
            self.arrange(settle(self.mesh, self.points, configuration))
            return
        changes = find_changes(self, np.arange(self.points.count))
        self._bring_to_present(self.points.v, 1.0)
        self.project_anew()  # points that split ask for the velocity gradient
        self.arrange(settle(self.mesh, change_levels(self, changes), configuration))
        self._bring_to_present(self.points.v, -1.0)

    def _may_change(self) -> bool:
        """Whether a point, on any rank, has come so far that it may be due to change level."""
        if self.top == 0:
            return False
        way = np.abs(self.points.x[self._rim] - self._rim_x).max(initial=0.0)
        return self._largest(float(way >= self._leash)) > 0.0

    def _changes_due(self) -> bool:
        """Whether any point on any rank changes level, or more of a family may merge."""
        if self.top == 0:
            return False
        changing, out = self._count_changes()
        return changing > 0 or out != self._waiting

    def _count_changes(self) -> Ints:
        """How many points change level or split, and how many wait to merge, on all ranks."""
        changes = find_changes(self, self._rim)
        own = np.array([np.sum(changes.up | changes.down | changes.split), np.sum(changes.out)])
        return own if self.mesh.ranks == 1 else self.mesh.comm.allreduce(own)

    def _bring_to_present(self, v: Floats, sign: float) -> None:
        """Add to velocities, shape ``(n, d)``, what they lack to the present, or take it off."""
        if self.steps and not all(self._whole(level) for level in range(self.top + 1)):
            self._sum_mass(0)
            self._prepared = False  # for another span
            self._push(0, range(self.top + 1), self.time, self.time - self.clock)
            self.gather("all", self._U, sign, v)

    def arrange(self, points: MaterialPoints) -> None:
        """Take points that are on the right level and rank: sort them, fill stencils."""
        self.points = points
        configuration = self.scheme.configuration
        self._home, self._stripe = sort(self.mesh, self.points, configuration)
        p, d, place = self.points, self.hierarchy.dim, self.place
        p.rate[:] = subcycling.rate_of(p.level, place, self.hierarchy, self.scheme.dispersion > 0.0)
        self._reach = subcycling.reach_of(p.level, place, self.hierarchy)
        self._stripes: dict[str, Stripes] = {}
        self._stress, self._density = np.zeros((p.count, d, d)), np.zeros(p.count)
        self._later = np.zeros((p.count, d))
        arrays = (self.mesh, p, self.cracks, configuration)
        self._loads = make_loads(self._tractions, *arrays)
        self._dashpots = make_dashpots(self._absorbing, self.law, *arrays)
        if self.contact is not None:
            self.contact.regroup(p)
        self._damped = regions(self.scheme.damping, p)
        near = near_cracks(self.cracks, p.level, place, self.hierarchy)
        self.stencils = kernels.make_stencils(p.block, self.mesh.frames, near.size)
        self._near_cracks = near
        if self.top:
            self._rim, self._leash = near_rims(self)
            self._rim_x = place[self._rim]
            self._waiting = int(self._count_changes()[1])
        self._fill("all")
        self._dispersion: Dispersion | None = None
        self._prepared = False
        if self.fixed:
            self._sum_mass_of("summed 0", 0, self.M)
            self._sum_inner_mass(0)
            if self.scheme.dispersion > 0.0:
                self._dispersion = self._make_dispersion()

    def _make_dispersion(self) -> Dispersion:
        """Correct all nodes but those that touch or absorb."""
        mesh, p, active = self.mesh, self.points, self.active[0]
        dashpots = np.zeros_like(self.V)
        for dashpot in self._dashpots:
            dashpot.add(p, self._stretch, 1.0, dashpots)
        self._complete(active, dashpots)
        linked = mesh.basis & (self.mass_floor < self.M) & ~dashpots.any(axis=1)
        if self.contact is not None:
            linked[self.contact.upper] = linked[self.contact.lower] = False
        C = consistent_mass(self.stencils, mesh.slaves, p.mass, mesh.size)
        solved = [one.nodes for one in self.active]
        beta = self.scheme.dispersion
        return Dispersion(beta, linked, mesh, self.M, C, active.halo, solved)

    @property
    def place(self) -> Floats:
        """Where points stand on the background grid, shape ``(n, d)``."""
        return self.points.on_grid(self.scheme.configuration)

    def _fill(self, group: str) -> bool:
        """Compute stencils; says whether any point, on any rank, has drifted from home."""
        stripes, p = self.stripes(group), self.points
        kind = kernels.BSPLINE if self.scheme.interpolation == "bspline" else kernels.GIMP
        arrays = (self.place, self._half(), p.F, self._home)
        parts = self._team.gather(
            lambda first, last: kernels.fill_stencils(
                stripes.index,
                first,
                last,
                self.stencils,
                self.mesh.frames,
                kind,
                self._stretch,
                *arrays,
            ),
            stripes,
        )
        counts = np.sum(parts, axis=0)
        if self.mesh.ranks > 1:
            counts = self.mesh.comm.allreduce(counts)
        if counts[0]:
            raise self._lost_point()
        if self.cracks is not None:
            near = self._near_cracks
            fill_detours(self.cracks, self.mesh, p.reference, self.place, near, self.stencils)
        return bool(counts[1])

    def _half(self) -> Floats:
        if self.scheme.interpolation != "linear":
            return self.points.half
        return np.full_like(self.points.half, kernels.HAT)

    def _whole(self, level: int) -> bool:
        """Whether a level's velocities stand at whole steps, not at half ones."""
        integrator = self.scheme.integrator
        return integrator in ("usl", "usf") or (integrator == "usavg" and level == self.top)

    def _pace(self, level: int) -> Pace:
        if not self._whole(level):
            return Pace(self.dt_of(level), "middle")
        return Pace(self.dt_of(level), "ends" if self.scheme.integrator == "usavg" else "end")

    def lag(self, level: int) -> float:
        """Share of a level's last kick that separates its velocities from the present time."""
        return float((self.time - self.clock[level]) / self.span[level]) if self.steps else 0.0

    def synchronous(self) -> bool:
        """Whether all levels stand at the present time."""
        return subcycling.steppers(self.steps, self.top) == 0

    def velocity_gradient(self, chosen: Ints) -> Floats:
        """``L = sum_i V_i grad S_ip`` at some points, shape ``(len(chosen), d, d)``."""
        p = self.points
        F, x = np.zeros_like(p.F), p.x.copy()
        if chosen.size:
            arrays = (self.stencils, self.V, 1.0, False, F, 0.0, x)
            kernels.gather_motion(chosen, 0, chosen.size, *arrays)
        return F[chosen]

    def _largest(self, value: float) -> float:
        """Largest of a number over all ranks."""
        if self.mesh.ranks == 1:
            return value
        return float(max(self.mesh.comm.allgather(value)))

    def _filter_due(self) -> bool:
        every = self.scheme.xpic_every
        per_step = 2**self.top
        done, before = self.steps, self.steps - per_step
        return not self.fixed and every > 0 and done // every > before // every

    def _make_active(self, level: int) -> Active:
        mesh = self.mesh
        touched = subcycling.touched(mesh, level)
        slaves = mesh.slaves.among(touched)
        shared = {rank: ids[touched[ids]] for rank, ids in mesh.shared.items()}
        touched[slaves.master] = True
        solved = subcycling.whole(mesh, level) & mesh.basis
        return Active(
            nodes=np.flatnonzero(solved),
            cleared=np.flatnonzero(touched),
            unsolved=np.flatnonzero(touched & ~solved),
            slaves=slaves,
            halo=Halo(mesh.comm, {rank: ids for rank, ids in shared.items() if ids.size}),
        )

    def _lost_point(self) -> BackendError:
        p, t = self.points, in_blocks(self.mesh, self.points, self.scheme.configuration)
        inside = ((t >= 0.5) & (t < self.mesh.frames.shape[p.block] - 1.5)).all(axis=1)
        lost = np.flatnonzero(~inside)
        where = (
            "on another rank"
            if lost.size == 0
            else "from (" + ", ".join(f"{c:g}" for c in p.reference[lost[0]]) + ")"
        )
        return BackendError(
            f"GIMP: a material point {where} left the background grid at t = {self.time:g}; the "
            "run is unstable, or the load tears the body apart: reduce time.md_steps or the load"
        )


def regions(damping: Sequence[Region], points: MaterialPoints) -> tuple[Floats, Floats] | None:
    """Rate of decay and share of FLIP of every point, later regions winning; None without any."""
    if not damping:
        return None
    rate, flip = np.zeros(points.count), np.ones(points.count)
    for region in damping:
        inside = np.ones(points.count, dtype=np.bool_)
        for axis, (low, high) in enumerate(region.box or ()):
            inside &= (points.reference[:, axis] >= low) & (points.reference[:, axis] <= high)
        rate[inside], flip[inside] = region.rate, region.flip
    return rate, flip

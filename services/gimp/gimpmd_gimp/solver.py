"""One step of GIMP on a single level: USAVG with midpoint updates, or MUSL.

The step is written as the method is told: points to nodes, field solve, nodes to points. Points
that another code moves (the inner zone of a coupled run) take part in the nodal sums but are not
strained or moved here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from gimpmd_gimp import kernels
from gimpmd_gimp.cracks import Cracks, fill_detours, near_cracks
from gimpmd_gimp.faces import Driven, Traction
from gimpmd_gimp.materials import LinearElastic
from gimpmd_gimp.points import MaterialPoints
from gimpmd_gimp.threads import Blocks, Team, make_blocks
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid import BackgroundGrid, Bools, Floats, Ints

MASS_FLOOR = 1e-12
"""Nodes with less than this fraction of a full node's mass have no velocity."""


@dataclass(frozen=True)
class Scheme:
    """How a step is taken.

    Attributes
    ----------
    integrator : ``usavg`` or ``musl``.
    stretch : whether the points' domains follow the strain (cpGIMP).
    xpic_order, xpic_every : the XPIC filter of FLIP's null space and how often it acts.
    """

    integrator: Literal["usavg", "musl"]
    stretch: bool = False
    xpic_order: int = 5
    xpic_every: int = 20


class Solver:
    """GIMP on one uniform background grid.

    Parameters
    ----------
    grid : BackgroundGrid
    points : MaterialPoints
        Changed in place by every step.
    material : LinearElastic
    scheme : Scheme
    dt : float
        Time step.
    tractions, driven : list
        Conditions on the faces.
    cracks : Cracks
        Traction-free cracks; may be none.
    inner : ndarray of int64
        Points that follow another code.
    booked : ndarray of bool, shape ``(nodes,)``
        Nodes at which the work of the faces counts.
    threads : int
        How many share the sweeps.

    Attributes
    ----------
    V : ndarray, shape ``(nodes, 2)``
        Nodal velocity after the last step: the points' new momentum, projected.
    external_work, interface_work : float
        Work of the faces on the body, and of the inner points on the rest, so far (mechanical).
    """

    def __init__(
        self,
        grid: BackgroundGrid,
        points: MaterialPoints,
        material: LinearElastic,
        scheme: Scheme,
        dt: float,
        tractions: list[Traction],
        driven: list[Driven],
        cracks: Cracks,
        inner: Ints,
        booked: Bools,
        threads: int = 1,
    ) -> None:
        self.grid, self.points, self.material = grid, points, material
        self.scheme, self.dt = scheme, dt
        self.tractions, self.driven, self.cracks = tractions, driven, cracks
        self.time, self.steps = 0.0, 0
        self.external_work, self.interface_work = 0.0, 0.0

        n = points.count
        self._team = Team(threads)
        self.columns = grid.shape[1]
        self.nodes = grid.size + cracks.twins.size
        self.origin = np.array(grid.origin)
        self.period = np.array(grid.cells) * grid.cell * np.array(grid.periodic)
        # periodic images are not counted again
        self._counts = np.concatenate([grid.canonical(), np.ones(cracks.twins.size)])
        self._booked = self._counts * booked
        self.base = np.zeros(n, dtype=np.int64)
        self.w = np.zeros((n, kernels.WEIGHTS))
        self.stress = np.zeros((n, 3))
        self.across = np.full(n, -1, dtype=np.int64)
        self._near_cracks = near_cracks(cracks, points.reference, grid)
        self._detour = np.zeros((max(1, self._near_cracks.size), 9), dtype=np.int64)

        density = float(points.mass.sum() / points.volume.sum())
        self.mass_floor = MASS_FLOOR * density * grid.cell**2
        is_inner = np.zeros(n, dtype=np.bool_)
        is_inner[inner] = True
        self._chosen = {
            "all": np.arange(n, dtype=np.int64),
            "regular": np.flatnonzero(~is_inner).astype(np.int64),
            "inner": inner,
        }
        self._traction_forces: list[Floats] = []
        self._reactions: list[Floats] = []
        self._interface_force = np.zeros((self.nodes, 2))
        self._block_row = np.zeros(n, dtype=np.int64)
        self.blocks: dict[str, Blocks] = {}
        self._sort()
        self.M = np.zeros(self.nodes)
        self.V = np.zeros((self.nodes, 2))
        self.refresh()
        self.V = self.project_anew()

    def add_group(self, name: str, chosen: Ints) -> None:
        """Name a group of points, to sweep over it alone."""
        self._chosen[name] = chosen
        self.blocks[name] = make_blocks(chosen, self._block_row, self.grid.shape[0])

    def refresh(self, group: str = "all") -> None:
        """Stencils of a group at the points' current positions.

        Raises
        ------
        BackendError
            A point has left the background grid.
        """
        blocks, p = self.blocks[group], self.points
        parts = self._team.gather(
            lambda first, last: kernels.fill_stencils(
                blocks.order,
                first,
                last,
                p.x,
                p.half,
                self.origin,
                self.period,
                self.grid.cell,
                self.grid.shape,
                self._block_row,
                self.base,
                self.w,
            ),
            blocks,
        )
        lost, drifted = (sum(counts) for counts in zip(*parts, strict=True))
        if lost:
            raise self._lost_point()
        if drifted:
            self._block_row = self.base // self.columns
            self._sort()
        if self._near_cracks.size:
            fill_detours(
                self.base,
                p.x,
                self.columns,
                self.origin,
                self.grid.cell,
                self.cracks.segments,
                self.cracks.twin,
                self._near_cracks,
                self.across,
                self._detour,
            )

    def step(self) -> None:
        """Advance all regular points by one time step."""
        if self.scheme.integrator == "usavg":
            self._usavg()
        else:
            self._musl()
        self.steps += 1
        if self.scheme.xpic_every and self.steps % self.scheme.xpic_every == 0:
            noise = self.null_space(["all"] * (self.scheme.xpic_order + 1))
            regular = self._chosen["regular"]
            self.points.v[regular] -= noise[regular]

    def null_space(self, groups: Sequence[str]) -> Floats:
        """The part ``(I - Pi)^m v`` of the velocities that the grid does not see, shape ``(n, 2)``.

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
            field = self.project(part, before, held=1.0 if number == 0 else 0.0)
            self.gather(after, field, -1.0, part)
        return part

    def project(self, q: Floats, group: str, held: float = 1.0) -> Floats:
        """Nodal velocity of a point field, weighted by mass (paper Eq. 16)."""
        P = np.zeros((self.nodes, 2))
        self.scatter(group, q, P)
        self.fold(P)
        return self.velocity(P, held)

    def project_anew(self) -> Floats:
        """Nodal velocity of all points, with their nodal mass at the present stencils."""
        M, P = np.zeros(self.nodes), np.zeros((self.nodes, 2))
        self._scatter(kernels.scatter_momentum, "all", self.points.mass, self.points.v, M, P)
        for field in (M, P):
            self.fold(field)
        self.M = M
        return self.velocity(P)

    def scatter(self, group: str, q: Floats, Q: Floats) -> None:
        """Add ``S_ip m_p q_p`` of a group to ``Q``."""
        self._scatter(kernels.scatter_vector, group, self.points.mass, q, Q)

    def gather(self, group: str, Q: Floats, factor: float, q: Floats) -> None:
        """Add ``factor`` times the interpolated ``Q`` to a group's rows of ``q`` (paper Eq. 5)."""
        self._gather(kernels.gather_vector, group, Q, factor, q)

    def move(self, group: str, V: Floats, dt: float, x_step: float) -> None:
        """Strain a group with ``V`` over ``dt`` and shift it by ``x_step`` of it."""
        p = self.points
        stretch = self.scheme.stretch
        self._gather(
            kernels.gather_motion, group, V, dt, stretch, x_step, p.strain, p.half, p.volume, p.x
        )

    def energies(self, group: str) -> Floats:
        """Kinetic and strain energy, mass and momentum of a group now, shape ``(5,)``."""
        p, blocks = self.points, self.blocks[group]
        # MUSL's velocities stand half a step back
        lag = 0.5 * self.dt if self.scheme.integrator == "musl" and self.steps else 0.0
        self.material.stress(p.strain, self.stress)
        arrays = (p.mass, p.v, p.a, lag, p.volume, self.stress, p.strain)
        parts = self._team.gather(
            lambda first, last: kernels.sum_energies(blocks.order, first, last, *arrays), blocks
        )
        return np.sum(parts, axis=0)

    def velocity(self, P: Floats, held: float = 1.0) -> Floats:
        """Nodal velocity of a momentum; driven components at ``held`` times their values."""
        V = kernels.divide(P, self.M, self.mass_floor)
        for driven in self.driven:
            V[driven.nodes, driven.component] = held * driven.velocity(self.time)
        return V

    def _musl(self) -> None:
        """Modified update stress last: strain with the projected new momentum."""
        p, dt = self.points, self.dt
        self.refresh()
        self.material.stress(p.strain, self.stress)
        A = self._accelerate(load_time=self.time)

        # its velocities stand at half steps, so the first kick is half a step long
        P = self._kick(A, dt if self.steps else 0.5 * dt)
        self.time += dt
        self.V = self.velocity(P)
        self._book_work(self.V)
        self.move("regular", self.V, dt, dt)

    def _usavg(self) -> None:
        """Update stress averaged: half a strain step with the old and half with the new field.

        Positions and loads are taken at the midpoint: ``x += dt (v_L - a dt / 2)``.
        """
        p, dt = self.points, self.dt
        self.refresh()
        V = self.project_anew()
        self.move("regular", V, 0.5 * dt, 0.0)
        self.material.stress(p.strain, self.stress)
        A = self._accelerate(load_time=self.time + 0.5 * dt)

        P = self._kick(A, dt)
        self.time += dt
        self.V = self.velocity(P)
        self._book_work(0.5 * (V + self.V))
        self.move("regular", self.V, 0.5 * dt, 0.0)
        self.gather("regular", V + 0.5 * dt * A, dt, p.x)

    def _accelerate(self, load_time: float) -> Floats:
        """Solve the nodes: acceleration from internal force and tractions, faces respected."""
        M_in, F_in = self._sum_force("inner")
        M, F = self._sum_force("regular")
        self._traction_forces = [
            t.nodal_force(self.points, self.origin, self.grid.cell, self.columns, self.nodes)
            for t in self.tractions
        ]
        total = F + F_in
        for traction, force in zip(self.tractions, self._traction_forces, strict=True):
            self.fold(force)
            total += traction.face.factor(load_time) * force
        self.M = M + M_in
        A = kernels.divide(total, self.M, self.mass_floor)
        self._reactions = []
        for driven in self.driven:
            change = driven.velocity(self.time + self.dt) - driven.velocity(self.time)
            held = A[driven.nodes, driven.component] - change / self.dt
            self._reactions.append(-self.M[driven.nodes] * held)
            A[driven.nodes, driven.component] = change / self.dt
        self._interface_force = F_in - M_in[:, None] * A
        return A

    def _kick(self, A: Floats, dt: float) -> Floats:
        """FLIP update of all points, a predictor for the inner ones; returns their momentum."""
        p, P = self.points, np.zeros((self.nodes, 2))
        self._scatter(kernels.kick, "all", A, dt, p.mass, p.v, p.a, P)
        self.fold(P)
        return P

    def _sum_force(self, group: str) -> tuple[Floats, Floats]:
        """Nodal mass and internal force of a group."""
        p, M, F = self.points, np.zeros(self.nodes), np.zeros((self.nodes, 2))
        self._scatter(kernels.scatter_force, group, p.mass, p.volume, self.stress, M, F)
        for field in (M, F):
            self.fold(field)
        return M, F

    def _book_work(self, V: Floats) -> None:
        """Work over the step that ends now, with the velocity that strained the points."""
        for traction, force in zip(self.tractions, self._traction_forces, strict=True):
            before = traction.face.factor(self.time - self.dt)
            after = traction.face.factor(self.time)
            power = kernels.power(force, V, self._booked)
            self.external_work += self.dt * 0.5 * (before + after) * power
        for driven, reaction in zip(self.driven, self._reactions, strict=True):
            force = np.zeros_like(V)
            force[driven.nodes, driven.component] = reaction
            self.external_work += self.dt * kernels.power(force, V, self._booked)
        self.interface_work += self.dt * kernels.power(self._interface_force, V, self._counts)

    def _scatter(self, kernel: Callable[..., None], group: str, *arrays: object) -> None:
        """Sweep that writes to nodes, over the points of a group with their stencils."""
        self._team.scatter(self._bound(kernel, group, arrays), self.blocks[group])

    def _gather(self, kernel: Callable[..., None], group: str, *arrays: object) -> None:
        """Sweep that writes to the points of a group alone."""
        self._team.gather(self._bound(kernel, group, arrays), self.blocks[group])

    def _bound(
        self, kernel: Callable[..., None], group: str, arrays: Sequence[object]
    ) -> Callable[[int, int], None]:
        stencils = (self.base, self.w, self.columns, self.across, self._detour)
        order = self.blocks[group].order
        return lambda first, last: kernel(order, first, last, *stencils, *arrays)

    def fold(self, field: Floats) -> None:
        """Add up nodal sums on periodic images, in place."""
        if any(self.grid.periodic):
            padded = field[: self.grid.size].reshape(*self.grid.shape, *field.shape[1:])
            self.grid.fold(padded)

    def _sort(self) -> None:
        """Sort all groups into blocks by the node rows in which the points stand."""
        for name, chosen in self._chosen.items():
            self.blocks[name] = make_blocks(chosen, self._block_row, self.grid.shape[0])

    def _lost_point(self) -> BackendError:
        low, high = self.origin, self.origin + np.array(self.grid.cells) * self.grid.cell
        inside = ((self.points.x > low) & (self.points.x < high)).all(axis=1)
        X = self.points.reference[np.flatnonzero(~inside)[0]]
        return BackendError(
            f"GIMP: the material point from ({X[0]:g}, {X[1]:g}) left the background grid at "
            f"t = {self.time:g}; the run is unstable, or the load tears the body apart: reduce "
            "time.md_steps or the load"
        )

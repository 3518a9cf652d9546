"""Scheme S: boundary atoms follow the grid, and the grid sees the mean motion of deeper atoms.

In the reference configuration atoms are seen at their lattice positions, so weights never change
and what velocities sum up to is the projection of the whole displacements: thermal motion leaves no
drift. In the current one they are seen where they are. And Ma et al.'s own (``paper``): the grid
sees the motion at the sync, by a lumped projection.
"""

from __future__ import annotations

import numpy as np

from gimpmd_md.coupling.halo import HALO_CELLS, Halo
from gimpmd_md.coupling.projection import ITERATIONS, NodeMap, sums_per_node
from gimpmd_md.coupling.scheme import BOUNDARY, CORE, PROJECTED
from gimpmd_md.engines.lammps.library import Engine
from gimpmd_md.sums import mean_velocity, periods
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.zones import owners
from gimpmd_schemas.mechanics.initial_state import initial_state

PROJECTED_CELLS = 3.0
"""How much deeper than the innermost points, in cells, atoms are projected.

An inner point touches nodes up to 1.5 cells away, and these gather atoms up to 1.5 cells further;
deeper atoms cannot change what the continuum reads but for corrections of the projection.
"""


class VelocityExchange:
    """Nodal mass and velocity of the atoms against nodal velocities; see ``exchange.Exchange``.

    Parameters
    ----------
    case : Case
    engine : Engine
    spacing : float
        Distance of atoms, ``sqrt(area per atom)``; at most one cell.
    """

    def __init__(self, case: Case, engine: Engine, spacing: float) -> None:
        self._case, self._engine = case, engine
        self._zones = case.zones()
        self._fixed = case.configuration() == "reference"
        self._place = "d2_gimpmd_lattice" if self._fixed else "x"
        grid, region, counts = case.background_grid(), case.md_region(), case.md_patches()
        comm = engine.comm
        self._period = periods(grid)
        self._halo = Halo(comm, grid, region, counts)
        self._node_map = NodeMap(grid, self._halo.nodes, self._halo.patch, HALO_CELLS, spacing)
        self._halo.connect(self._node_map.places, sums_per_node(grid.dim))
        inner, outer = self._zones.inner_nodes(grid), self._zones.outer_nodes(grid)
        self.offers = inner[owners(region, counts, grid.positions()[inner]) == comm.rank]
        self.needs = np.intersect1d(outer, self._halo.nodes)
        self.bonded = CORE
        self._offered = self._node_map.places(self.offers)
        self._shown, self._needed = self._node_map.spread(self.needs)
        self._field = np.full((self._node_map.size, 2), np.nan)

    def parts(self, x: Floats) -> Ints:
        """By depth: boundary atoms, those behind the energy plane, and those that the grid sees."""
        zones, depth = self._zones, self._zones.depth(x)
        deepest = zones.innermost + PROJECTED_CELLS * self._case.finest_cell()
        part = np.where(depth < zones.outer, BOUNDARY, 0)
        part |= np.where(depth > zones.energy_plane, CORE, 0)
        part |= np.where(depth < deepest, PROJECTED, 0)
        return part

    def initial_state(self) -> tuple[Floats, Floats]:
        """The case's own."""
        u, v, _ = initial_state(self._case, self._engine.pairs("d2_gimpmd_rest"))
        return u, v

    def drive(self, velocity: Floats) -> None:
        """Interpolate the velocities of boundary atoms where they stand on the grid now."""
        engine = self._engine
        part, x = engine.atoms("i_gimpmd_part"), engine.pairs(self._place)
        self._field[self._shown] = velocity[self._needed]
        if not self._node_map.follow(part, BOUNDARY, x, self._field, engine.pairs("v")):
            raise BackendError(
                "a boundary atom has drifted off the nodes that the continuum sends: the body has "
                "moved by more than a cell since the start"
            )

    def fields(self, span: float) -> dict[str, Floats]:
        """Mass and velocity of the way over the last window, seen half-way; at the start of now.

        In the reference configuration they are seen where they always are.
        """
        engine, paper = self._engine, self._case.coupling.scheme == "paper"
        x, q = engine.pairs("x"), engine.pairs("v")
        if paper:
            span = 0.0
        if span > 0.0:
            q = np.empty_like(x)
            mean_velocity(x, engine.pairs("d2_gimpmd_last"), self._period, span, q)
        sums, velocity = self._node_map.project(
            engine.atoms("i_gimpmd_part"),
            PROJECTED,
            engine.masses(),
            engine.pairs(self._place),
            q,
            0.0 if self._fixed else 0.5 * span,
            self._halo.complete,
            0 if paper else ITERATIONS,
        )
        return {"mass": sums[self._offered, 0], "velocity": velocity[self._offered]}

    def dissipated(self) -> float:
        """Nothing: what the exchange loses is not its purpose."""
        return 0.0

"""The velocity scheme: boundary atoms follow the grid, which sees the motion of deeper atoms.

In the reference configuration atoms are seen at their lattice positions. Then the weights never
change, and the sum of all velocities is the projection of the whole displacement: thermal motion
leaves no drift. In the current configuration atoms are seen at their positions. In the scheme
``paper``, that of Ma et al., the grid sees the velocities at the end of the step, by a lumped
projection.
"""

from __future__ import annotations

import numpy as np

from gimpmd_md.coupling.halo import Exchange, Halo
from gimpmd_md.coupling.projection import ITERATIONS, NodeMap, left_the_grid, sums_per_node
from gimpmd_md.engines.atoms import Array, Atoms
from gimpmd_md.roles import BOUNDARY, CORE, PROJECTED
from gimpmd_md.sums import mean_velocity, periods
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.initial_state import initial_state
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.checkpoint.states import SavedStates
from gimpmd_schemas.errors import BackendError

PROJECTED_CELLS = 3.0
"""How much deeper than the innermost material points, in cells, atoms are projected.

An inner point touches nodes up to 1.5 cells away, and these gather atoms up to 1.5 cells further.
Deeper atoms can change what the continuum reads only through the corrections of the projection.
"""


class VelocityScheme:
    """Nodal mass and velocity of the atoms against nodal velocities; see `scheme.Scheme`.

    Parameters
    ----------
    plan : Plan
        Of a coupled run.
    atoms : Atoms
        At their lattice positions.
    spacing : float
        Distance of neighbouring atoms; at most one cell.
    """

    bonded, sees_paths = CORE, True
    dissipated = work_of_nodes = 0.0

    def __init__(self, plan: Plan, atoms: Atoms, spacing: float) -> None:
        self._plan, self._atoms = plan, atoms
        self._zones = plan.coupled.zones
        self._fixed = plan.continuum.configuration == "reference"
        self._paper = plan.coupled.scheme == "paper"
        self._spacing, self._grid = spacing, plan.background_grid()
        grid, region, counts = self._grid, plan.atoms.region, plan.atoms.patches
        self._period = periods(grid)
        self._halo = Halo(atoms.comm, grid, region, counts)
        self._driving = Halo(atoms.comm, grid, region, counts, self._zones.outer_nodes(grid))
        self.offers = np.intersect1d(self._zones.inner_nodes(grid), self._halo.own)
        self.needs = self._driving.home
        self._prepare()
        self._migrations: int | None = None  # of the atoms when they were last projected

    def _prepare(self) -> None:
        """Get ready for projections and interpolations with the nodes that the rank holds."""
        self._node_map = NodeMap(self._grid, self._halo.nodes, self._spacing)
        places = self._node_map.places
        self._exchange = Exchange(self._halo, places, sums_per_node(self._plan.dim))
        self._offered = places(self.offers)
        self._shown, self._needed = self._node_map.spread(self._driving.nodes)
        self._field = np.full((self._node_map.size, self._plan.dim), np.nan)

    def roles(self) -> Ints:
        """Roles by depth: boundary atoms, atoms behind the energy plane, and projected atoms."""
        zones = self._zones
        depth = zones.depth(self._atoms.site)
        deepest = zones.innermost + PROJECTED_CELLS * self._plan.finest_cell
        role = np.where(depth < zones.outer, BOUNDARY, 0)
        role |= np.where(depth > zones.energy_plane, CORE, 0)
        role |= np.where(depth < deepest, PROJECTED, 0)
        return role

    def initial_state(self) -> tuple[Floats, Floats]:
        """The initial state of the case."""
        u, v, _ = initial_state(self._plan, self._atoms.rest)
        return u, v

    def drive(self, velocity: Floats) -> None:
        """Interpolate the velocities of the boundary atoms where the grid sees them now."""
        atoms = self._atoms
        self._field[self._shown] = self._driving.distribute(velocity)[self._needed]
        if not self._node_map.follow(atoms.role, BOUNDARY, self._seen(), self._field, atoms.v):
            raise BackendError(
                "a boundary atom has drifted off the nodes that the continuum sends: the body has "
                "moved by more than a cell since the start"
            )

    def fields(self, span: float) -> dict[str, Floats]:
        """Nodal mass, and nodal velocity: the mean over the coupling step.

        In the current configuration atoms are seen halfway along their path. At the start of the
        run, and in the scheme ``paper``, the velocities are those at the end.
        """
        atoms = self._atoms
        # in the layout of the means, because kernels are compiled for each layout
        x, q = atoms.x, np.ascontiguousarray(atoms.v)
        if self._paper:
            span = 0.0
        if span > 0.0:
            q = np.empty_like(x)
            mean_velocity(x, atoms.last, self._period, span, q)
        sums = self._sums(q, 0.0 if self._fixed else 0.5 * span)
        self._exchange.complete(sums)
        velocity = self._node_map.solve(sums, 0 if self._paper else ITERATIONS)
        return {"mass": sums[self._offered, 0], "velocity": velocity[self._offered]}

    def state(self) -> dict[str, Array]:
        """Nothing of its own."""
        return {}

    def restore(self, saved: SavedStates) -> None:
        """Nothing to take."""

    def _sums(self, q: Floats, back: float) -> Floats:
        """Nodal sums of the atoms of this rank.

        Collective if atoms may touch other nodes than before. Then the ranks agree whether all of
        them still hold the nodes of their atoms, and otherwise they hold other nodes.

        Raises
        ------
        BackendError
            An atom has left the grid.
        """
        atoms, x = self._atoms, self._seen()
        part = atoms.role, PROJECTED, atoms.mass, x, q, back
        sums, stray = self._node_map.assemble(*part)
        if not self._fixed or atoms.migrations != self._migrations:
            self._migrations = atoms.migrations
            if atoms.comm.allreduce(int(stray >= 0)):
                seen = (atoms.role & np.int32(PROJECTED)) != 0
                self._hold_nodes_around(x[seen] - back * q[seen])
                sums, stray = self._node_map.assemble(*part)
        if stray >= 0:
            raise left_the_grid(x[stray])
        return sums

    def _hold_nodes_around(self, x: Floats) -> None:
        self._halo.surround(x)
        self._driving.surround(x)
        self._exchange.free()
        self._prepare()

    def _seen(self) -> Floats:
        """Positions at which the grid sees the atoms."""
        return self._atoms.site if self._fixed else self._atoms.x

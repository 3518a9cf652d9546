"""Velocity schemes on the continuum's side: inner points follow the atoms, a filter acts nearby.

The velocity exchange of the paper (section 4.1), made stable. The consistent nodal velocities of
the atoms move the inner points. The velocities of the inner points are then corrected until the
grid sees the field of the atoms again. A filter removes, from the points near the interface, what
the grid cannot see: two overlapping domains would otherwise feed it into each other. Without
corrections and filter it is the exchange as published (scheme ``paper``).

These schemes move material points, so they need GIMP.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from msgspec.structs import replace

from gimpmd_gimp.coupling.nodes import find_nodes
from gimpmd_gimp.points.groups import INNER
from gimpmd_gimp.step.solver import Solver
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.checkpoint.states import TOTAL, Array, SavedStates
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.zones import Zones
from gimpmd_schemas.wire.energies import Energies, from_array, to_array
from gimpmd_schemas.wire.findings import Finding

CORRECTIONS = 2
"""Corrections of the velocities of the inner points in the velocity scheme; the paper has none.

More corrections carry short waves a little better and are less stable (docs/theory.md).
"""

SHARED_NODES_CELLS = 3.0
"""Distance, in cells, within which two points may share nodes: twice half a stencil."""


class VelocityScheme:
    """Couples a GIMP solver to the atoms by nodal velocities; see ``Scheme``.

    Parameters
    ----------
    solver : Solver
        Its inner points are those between ``zones.handover`` and ``zones.innermost``. Zones and
        everything near them are on its finest level.
    grid : BackgroundGrid
        The grid that both sides share: its nodes are those of the finest level.
    zones : Zones
    filter_rate : float
        Strength of the zone filter per unit time; 0 for none.
    every : int
        Steps between two times with energies.
    corrections : int
        How often the velocities of the inner points are corrected towards the field of the atoms.

    Attributes
    ----------
    offers, needs : ndarray of int64
        Ids, on the shared grid, of the nodes whose fields this rank sends and receives.
    notes : tuple of str
        Nothing is to be said of the interface.
    """

    notes: tuple[str, ...] = ()

    def __init__(
        self,
        solver: Solver,
        grid: BackgroundGrid,
        zones: Zones,
        filter_rate: float,
        every: int,
        corrections: int = CORRECTIONS,
    ) -> None:
        self.solver, self._every, self._corrections = solver, every, corrections
        self._energies: Energies | None = None
        self._filtered = 0.0
        self.beta = min(1.0, filter_rate * solver.dt)
        rows = find_nodes(solver, grid, zones.inner_nodes(grid))
        self.needs, self._needed = zones.inner_nodes(grid)[rows >= 0], rows[rows >= 0]
        rows = find_nodes(solver, grid, zones.outer_nodes(grid))
        owned = (rows >= 0) & (solver.mesh.counts[rows] > 0.0)
        self.offers, self._offered = zones.outer_nodes(grid)[owned], rows[owned]

        body, distance = solver.body, SHARED_NODES_CELLS * grid.cell
        depth, inner = zones.depth(body.points.reference), body.mask(INNER)
        filtered = depth > -zones.filter
        self._outside = body.add_group(depth < zones.energy_plane)
        self._beside_inner = body.add_group((depth > zones.handover - distance) & ~inner)
        self._filter_groups = [
            body.add_group(depth > -zones.filter - 2.0 * distance),
            body.add_group(depth > -zones.filter - distance),
            body.add_group(filtered & ~inner),
        ]

    def zone_fields(self) -> dict[str, Floats]:
        """Nodal velocity of the last step on ``offers``, for the boundary atoms."""
        return {"velocity": self.solver.V[self._offered]}

    def finish(self) -> None:
        """Filter the zone, and sum the energies of the points outside the energy plane.

        The last kick brings velocities to the present, because the state of the step must not
        change before the fields of the atoms arrive.
        """
        solver = self.solver
        if solver.steps:
            self.filter_transition()
        self._energies = None
        if solver.steps % self._every == 0:
            energies = solver.tally(self._outside, exact=False)
            self._energies = replace(energies, interface_work=solver.work.interface)

    def receive(self, fields: Mapping[str, Floats]) -> None:
        """Let the inner points follow the atoms; before the first step they stay as set up."""
        if self.solver.steps:
            self.follow_atoms(fields)

    def advance(self) -> None:
        """Take a step."""
        self.solver.step()

    def energies(self) -> Energies | None:
        """See ``Scheme``; what the filter removed counts as dissipated."""
        found = self._energies
        return found and replace(found, dissipated=self._filtered + found.dissipated)

    def state(self) -> dict[str, Array]:
        """What the filter has removed, and energies to report."""
        found = {TOTAL + "filtered": np.asarray(self._filtered)}
        if self._energies is not None:
            found[TOTAL + "energies"] = to_array(self._energies)
        return found

    def restore(self, saved: SavedStates) -> None:
        """Take what the filter has removed, and the energies to report."""
        self._filtered = float(saved.total("filtered"))
        due = self.solver.steps % self._every == 0
        self._energies = from_array(saved.total("energies")) if due else None

    def misfit(self) -> tuple[Finding, ...]:
        """No finding: the crystal of the atoms is not known in this scheme."""
        return ()

    def follow_atoms(self, fields: Mapping[str, Floats]) -> None:
        """Move and deform the inner points with the atoms' nodal velocity (paper Eqs. 5, 7, 8).

        Stencils and nodal mass are those of the step that ended now.

        Parameters
        ----------
        fields : mapping
            ``mass`` of shape ``(n,)`` and ``velocity`` of shape ``(n, d)`` on the nodes ``needs``:
            averages over the coupling step that ends now.

        Raises
        ------
        BackendError
            An inner point touches a node for which the atoms send nothing.
        """
        solver, body, v = self.solver, self.solver.body, self.solver.points.v
        inner = body.stripes(INNER).order
        V = np.full_like(solver.V, np.nan)
        V[self._needed] = fields["velocity"]
        solver.mesh.constraints.prolong(V)
        v[inner] = 0.0
        body.gather(INNER, V, 1.0, v)
        if not np.isfinite(v[inner]).all():
            raise BackendError(
                "an inner point has drifted off the nodes that the atoms send: the body has moved "
                "by more than a cell since the start"
            )
        body.run(*body.deforming(INNER, V, solver.dt, solver.dt))

        beside = np.zeros_like(solver.V)
        body.scatter(self._beside_inner, v, beside)
        known = (fields["mass"] > solver.nodes.mass_floor)[:, None]
        missing = np.zeros_like(solver.V)
        for _ in range(self._corrections):
            P = beside.copy()
            body.scatter(INNER, v, P)
            seen = solver.velocity_of(P, solver.top)[self._needed]
            missing[self._needed] = known * (fields["velocity"] - seen)
            solver.mesh.constraints.prolong(missing)
            body.gather(INNER, missing, 1.0, v)

    def filter_transition(self) -> None:
        """Remove a part of what the grid does not see from the points near the interface."""
        if self.beta == 0.0:
            return
        solver, p = self.solver, self.solver.points
        part = solver.null_space(self._filter_groups, solver.top)
        filtered = solver.body.stripes(self._filter_groups[-1]).order
        new = p.v[filtered] - self.beta * part[filtered]
        lost = p.mass[filtered] @ (p.v[filtered] ** 2 - new**2).sum(axis=1)
        self._filtered += 0.5 * float(lost)
        p.v[filtered] = new

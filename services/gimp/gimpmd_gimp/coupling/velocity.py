"""Scheme S on the continuum's side: inner points follow the atoms, the zone filter, what is sent.

The velocity exchange of the paper (section 4.1) made stable: the atoms' consistent nodal
velocities move the inner points, whose own velocities are corrected until the grid sees the
atoms' field again; a filter takes from the points near the interface what the grid cannot see,
which is what two overlapping domains would otherwise feed into each other. Without corrections
and filter it is the exchange as published (scheme ``paper``).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gimpmd_gimp.coupling.scheme import Books, find_nodes, sum_up
from gimpmd_gimp.step.solver import Solver
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.background import BackgroundGrid
from gimpmd_schemas.grid.zones import Zones

CORRECTIONS = 2
"""Corrections of the inner points' velocities in scheme S; the paper has none.

More carry short waves a little better and are less stable (docs/theory.md).
"""

REACH = 3.0
"""Cells within which points share nodes: a stencil's reach of a cell and a half, twice."""


class VelocityExchange:
    """Ties a solver to the atoms by nodal velocities; see ``exchange.Exchange``.

    Parameters
    ----------
    solver : Solver
        Its points "inner" are those between ``zones.handover`` and ``zones.innermost``; zones and
        all that lies near them are on its finest level.
    grid : BackgroundGrid
        The grid that both sides share: its nodes are those of the finest level.
    zones : Zones
    filter_rate : float
        Strength of the zone filter per unit time; 0: none.
    every : int
        Steps between the times at which energies are wanted.
    corrections : int
        Times the inner points' velocities are corrected towards the atoms' field.

    Attributes
    ----------
    offers, needs : ndarray of int64
        Ids, on the shared grid, of the nodes that this rank sends and wants.
    """

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
        self._books: Books | None = None
        self._filtered = 0.0
        self.beta = min(1.0, filter_rate * solver.dt)
        held = find_nodes(solver, grid, zones.inner_nodes(grid))
        self.needs, self._needed = zones.inner_nodes(grid)[held >= 0], held[held >= 0]
        held = find_nodes(solver, grid, zones.outer_nodes(grid))
        owned = (held >= 0) & (solver.mesh.counts[held] > 0.0)
        self.offers, self._offered = zones.outer_nodes(grid)[owned], held[owned]

        depth, reach = zones.depth(solver.points.reference), REACH * grid.cell
        inner = solver.mask("inner")
        groups = {
            "beside inner": (depth > zones.handover - reach) & ~inner,
            "filtered": (depth > -zones.filter) & ~inner,
            "near filtered": depth > -zones.filter - reach,
            "around filtered": depth > -zones.filter - 2.0 * reach,
        }
        for name, members in groups.items():
            solver.add_group(name, members)

    def receive(self, fields: Mapping[str, Floats]) -> None:
        """Let the inner points follow the atoms; before the first step they stand as set up."""
        if self.solver.steps:
            self.follow_atoms(fields)

    def advance(self) -> None:
        """Take a step of GIMP."""
        self.solver.step()

    def finish(self) -> None:
        """Filter the zone, and sum up the points outside the energy plane.

        Velocities are brought to the present by the last kick: the sweeps' state must be that of
        the step when the atoms' fields arrive.
        """
        if self.solver.steps:
            self.filter_transition()
        self._books = sum_up(self.solver, "own", self._every, exact=False)

    def books(self) -> Books | None:
        """Sums of the last ``finish``."""
        return self._books

    def dissipated(self) -> float:
        """What the zone filter has taken."""
        return self._filtered

    def follow_atoms(self, fields: Mapping[str, Floats]) -> None:
        """Move and deform the inner points with the atoms' nodal velocity (paper Eqs. 5, 7, 8).

        Stencils and nodal mass are those of the step that ended now.

        Parameters
        ----------
        fields : mapping
            ``mass`` (n,) and ``velocity`` (n, 2) on the nodes ``needs``: averages over the window
            that ends now.
        """
        solver, v, top = self.solver, self.solver.points.v, self.solver.top
        inner = solver.stripes("inner").order
        V = np.full_like(solver.V, np.nan)
        V[self._needed] = fields["velocity"]
        solver.mesh.slaves.prolong(V)
        v[inner] = 0.0
        solver.gather("inner", V, 1.0, v)
        if not np.isfinite(v[inner]).all():
            raise BackendError(
                "an inner point has drifted off the nodes that the atoms send: the body has moved "
                "by more than a cell since the start"
            )
        solver.deform("inner", V, solver.dt, solver.dt)

        beside = np.zeros_like(solver.V)
        solver.scatter("beside inner", v, beside)
        known = (fields["mass"] > solver.mass_floor)[:, None]
        missing = np.zeros_like(solver.V)
        for _ in range(self._corrections):
            P = beside.copy()
            solver.scatter("inner", v, P)
            seen = solver.solve(P, top)[self._needed]
            missing[self._needed] = known * (fields["velocity"] - seen)
            solver.mesh.slaves.prolong(missing)
            solver.gather("inner", missing, 1.0, v)

    def filter_transition(self) -> None:
        """Take a little of what the grid does not see from the points near the interface."""
        if self.beta == 0.0:
            return
        solver = self.solver
        groups = ["around filtered", "near filtered", "filtered"]
        part = solver.null_space(groups, solver.top)
        filtered, p = solver.stripes("filtered").order, solver.points
        new = p.v[filtered] - self.beta * part[filtered]
        lost = p.mass[filtered] @ (p.v[filtered] ** 2 - new**2).sum(axis=1)
        self._filtered += 0.5 * float(lost)
        p.v[filtered] = new

    def zone_fields(self) -> dict[str, Floats]:
        """Nodal velocity of the last step on ``offers``, for the boundary atoms."""
        return {"velocity": self.solver.V[self._offered]}

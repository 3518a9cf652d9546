"""Scheme S on the continuum's side: inner points follow the atoms, the zone filter, what is sent.

The velocity exchange of the paper (section 4.1) made stable: the atoms' consistent nodal
velocities move the inner points, whose own velocities are corrected until the grid sees the
atoms' field again; a filter takes from the points near the interface what the grid cannot see,
which is what two overlapping domains would otherwise feed into each other.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gimpmd_gimp.solver import Solver
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid import Floats
from gimpmd_schemas.zones import Zones

CORRECTIONS = 3
"""Times the inner points' velocities are corrected towards the atoms' field."""

REACH = 3.0
"""Cells within which points share nodes: a stencil's reach of a cell and a half, twice."""


class VelocityExchange:
    """Ties a solver to the atoms by nodal velocities.

    Parameters
    ----------
    solver : Solver
        Its inner points are those between ``zones.handover`` and ``zones.innermost``.
    zones : Zones
    filter_rate : float
        Strength of the zone filter per unit time.
    """

    def __init__(self, solver: Solver, zones: Zones, filter_rate: float) -> None:
        self.solver = solver
        self.beta = min(1.0, filter_rate * solver.dt)
        self.needs = zones.inner_nodes(solver.grid)
        self.offers = zones.outer_nodes(solver.grid)
        self._images = np.flatnonzero(~solver.grid.canonical())
        self._imaged = solver.grid.images()[self._images]

        depth = zones.depth(solver.points.reference)
        inner, reach = depth >= zones.handover, REACH * solver.grid.cell
        self._inner = np.flatnonzero(inner)
        self._filtered = np.flatnonzero((depth > -zones.filter) & ~inner)
        groups = {
            "beside inner": (depth > zones.handover - reach) & ~inner,
            "filtered": (depth > -zones.filter) & ~inner,
            "near filtered": depth > -zones.filter - reach,
            "around filtered": depth > -zones.filter - 2.0 * reach,
        }
        for name, members in groups.items():
            solver.add_group(name, np.flatnonzero(members).astype(np.int64))

    def follow_atoms(self, fields: Mapping[str, Floats]) -> None:
        """Move and strain the inner points with the atoms' nodal velocity (paper Eqs. 5, 7, 8).

        Stencils and nodal mass are those of the step that ended now.

        Parameters
        ----------
        fields : mapping
            ``mass`` (n,) and ``velocity`` (n, 2) on the nodes ``needs``: averages over the window
            that ends now.
        """
        solver, v = self.solver, self.solver.points.v
        V = np.full((solver.nodes, 2), np.nan)
        V[self.needs] = fields["velocity"]
        self._fill_images(V)
        v[self._inner] = 0.0
        solver.gather("inner", V, 1.0, v)
        if not np.isfinite(v[self._inner]).all():
            raise BackendError(
                "an inner point has drifted off the nodes that the atoms send: the body has moved "
                "by more than a cell since the start"
            )
        solver.move("inner", V, solver.dt, solver.dt)

        beside = np.zeros((solver.nodes, 2))
        solver.scatter("beside inner", v, beside)
        known = (fields["mass"] > solver.mass_floor)[:, None]
        missing = np.zeros((solver.nodes, 2))
        for _ in range(CORRECTIONS):
            P = beside.copy()
            solver.scatter("inner", v, P)
            solver.fold(P)
            missing[self.needs] = known * (fields["velocity"] - solver.velocity(P)[self.needs])
            self._fill_images(missing)
            solver.gather("inner", missing, 1.0, v)

    def filter_transition(self) -> None:
        """Take a little of what the grid does not see from the points near the interface."""
        part = self.solver.null_space(["around filtered", "near filtered", "filtered"])
        self.solver.points.v[self._filtered] -= self.beta * part[self._filtered]

    def zone_fields(self) -> dict[str, Floats]:
        """Nodal velocity of the last step on ``offers``, for the boundary atoms."""
        return {"velocity": self.solver.V[self.offers]}

    def _fill_images(self, field: Floats) -> None:
        """Copy a nodal field to the nodes that repeat others across periodic faces."""
        field[self._images] = field[self._imaged]

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
from gimpmd_schemas.grid import Bools, Floats
from gimpmd_schemas.zones import Zones

CORRECTIONS = 3
"""Times the inner points' velocities are corrected towards the atoms' field."""

FILTER_ORDER = 2


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
        self._images = solver.grid.images()

        depth = zones.depth(solver.points.reference)
        reach = 3.0 * FILTER_ORDER * solver.grid.cell
        self._inner = np.flatnonzero(depth >= zones.handover)
        self._filtered = np.flatnonzero((depth > -zones.filter) & (depth < zones.handover))
        near = np.flatnonzero(depth > -zones.filter - reach).astype(np.int64)
        solver.add_group("transition", near)

    def follow_atoms(self, fields: Mapping[str, Floats]) -> None:
        """Move and strain the inner points with the atoms' nodal velocity (paper Eqs. 5, 7, 8).

        Parameters
        ----------
        fields : mapping
            ``mass`` (n,) and ``velocity`` (n, 2) on the nodes ``needs``: averages over the window
            that ends now.
        """
        solver, v = self.solver, self.solver.points.v
        V, known = self._on_grid(fields)
        solver.refresh("transition")
        solver.M, _, _ = solver.sum_state("transition")
        correction = np.zeros_like(v)
        solver.gather("inner", V, correction)
        v[self._inner] = correction[self._inner]
        solver.move("inner", V, solver.dt, solver.dt)
        for _ in range(CORRECTIONS):
            missing = np.where(known[:, None], V - solver.project(v, "transition"), 0.0)
            solver.gather("inner", missing, correction)
            v[self._inner] += correction[self._inner]

    def filter_transition(self) -> None:
        """Take a little of what the grid does not see from the points near the interface."""
        part = self.solver.null_space(self.solver.points.v, FILTER_ORDER, "transition")
        self.solver.points.v[self._filtered] -= self.beta * part[self._filtered]

    def zone_fields(self) -> dict[str, Floats]:
        """Nodal velocity of the last step on ``offers``, for the boundary atoms."""
        return {"velocity": self.solver.V[self.offers]}

    def _on_grid(self, fields: Mapping[str, Floats]) -> tuple[Floats, Bools]:
        """Payload on all nodes, periodic images and twins included; and where there is mass."""
        size = self.solver.grid.size
        V, mass = np.zeros((self.solver.nodes, 2)), np.zeros(self.solver.nodes)
        V[self.needs], mass[self.needs] = fields["velocity"], fields["mass"]
        V[:size], mass[:size] = V[self._images], mass[self._images]
        return V, mass > self.solver.mass_floor

"""Nodal sums of the inner points, which follow another code.

The stress of the inner points pushes the nodes that they share with the rest of the body, and
their inertia resists. What is left, ``J_i = f_i span - m_i dV_i`` over the inner points, is the
impulse of the inner points on the rest; its work is the interface work.

Where the inner points end inside the body, nodes are half filled, and stress on one side only
would push them as at a cut. Nodes that the rim touches get no internal force.
"""

from __future__ import annotations

import numpy as np

from gimpmd_gimp.boundary.condition import Kick
from gimpmd_gimp.grid.nodes import Nodes
from gimpmd_gimp.points.body import Body
from gimpmd_gimp.points.groups import INNER, RIM
from gimpmd_gimp.sweeps import kernels
from gimpmd_schemas.arrays import Ints


class InnerPoints:
    """The inner points of a body.

    Parameters
    ----------
    body : Body
    nodes : Nodes
    has_rim : bool
        Whether the last layer of the inner points ends inside the body.

    Attributes
    ----------
    impulse : ndarray, shape ``(size, d)``
        Impulse of the inner points on the rest in the last kick of the finest level.
    """

    def __init__(self, body: Body, nodes: Nodes, has_rim: bool) -> None:
        self._body, self._nodes, self._has_rim = body, nodes, has_rim
        self._mass, self._rim_mass = np.zeros_like(nodes.M), np.zeros_like(nodes.M)
        self.impulse = np.zeros_like(nodes.V)

    def sum_mass(self, coarsest: int) -> None:
        """Sum the nodal mass of the inner points, and of their rim."""
        groups = [(INNER, self._mass)] + [(RIM, self._rim_mass)] * self._has_rim
        for group, M in groups:
            self._nodes.clear(coarsest, M[:, None])
            self._body.scatter_mass(group, M)
            self._nodes.complete(coarsest, M[:, None])

    def sum_impulse(self, kick: Kick) -> None:
        """Add the impulse of the stress to ``impulse``, this rank's part."""
        span = kick.span[self._body.hierarchy.top]
        self._body.run(*self._body.internal_force(INNER, span, self.impulse))
        if not self._body.total_lagrangian:
            self.sum_mass(kick.coarsest)

    def relieve_rim(self, nodes: Ints) -> None:
        """Set the internal forces to zero on the nodes among these that the rim touches."""
        if self._has_rim:
            for internal in (self._nodes.impulse, self.impulse):
                kernels.clear_touched(self._nodes.axes, nodes, self._rim_mass, internal)

    def subtract_inertia(self, coarsest: int) -> None:
        """``J_i -= m_i dV_i`` with the mass of the inner points."""
        solved, nodes = self._nodes.active[coarsest].solved, self._nodes
        kernels.inertia(nodes.axes, solved, self._mass, nodes.dV, self.impulse)

"""Work of the external loads and of the inner points on the body, and what damping takes.

The work of an impulse in a kick is its product with the mean of the nodal velocities before and
after the kick. Half of it is added before the kick and half after it, since projected velocities
stay finite on nodes that carry load but hardly any mass.
"""

from __future__ import annotations

import numpy as np

from gimpmd_gimp.grid.nodes import Nodes
from gimpmd_gimp.step.inner import InnerPoints
from gimpmd_schemas.arrays import Floats


class Work:
    """Work so far on this rank.

    Parameters
    ----------
    nodes : Nodes
    counts : ndarray, shape ``(size,)``
        One for nodes whose loads count in the external work, else zero.
    loaded : bool
        Whether any condition loads the body.
    inner : InnerPoints or None

    Attributes
    ----------
    external : float
        Work of the loads and of prescribed velocities on the body.
    interface : float
        Work of the inner points on the rest of the body.
    damped : float
        Energy that damping has taken.
    """

    def __init__(
        self, nodes: Nodes, counts: Floats, loaded: bool, inner: InnerPoints | None
    ) -> None:
        self._nodes, self._counts, self._loaded, self._inner = nodes, counts, loaded, inner
        self._carrying = self._pushed = np.empty(0, dtype=np.int64)
        self.external, self.interface, self.damped = 0.0, 0.0, 0.0

    def find_nodes(self, coarsest: int) -> None:
        """Find the nodes on which something does work, when the impulses of a kick are complete.

        These are few: most loads act on faces.
        """
        nodes, inner = self._nodes, self._inner
        if self._loaded:
            self._carrying = nodes.carrying(coarsest, nodes.loads, self._counts)
        if inner is not None:
            self._pushed = nodes.carrying(coarsest, inner.impulse, nodes.mesh.counts)

    def add_half(self) -> None:
        """Add half of the work over a kick, with the present nodal velocity."""
        self.external += 0.5 * self.of_loads()
        if self._inner is not None:
            counts = self._nodes.mesh.counts
            self.interface += 0.5 * self._nodes.work(self._pushed, self._inner.impulse, counts)

    def of_loads(self) -> float:
        """Work of the impulse of the loads at the present nodal velocity."""
        if not self._loaded:
            return 0.0
        return self._nodes.work(self._carrying, self._nodes.loads, self._counts)

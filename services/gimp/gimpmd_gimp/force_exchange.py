"""Scheme F on the continuum's side: forces of the atoms act on nodes, nodal velocities go back.

Ghost atoms move with the nodes, so the forces that free atoms exert on them belong to the nodes by
the same weights; the part of their bonds that the continuum already is gets subtracted
(``interface``). All of it derives from one energy of free atoms and nodal displacements, and steps
are those of leapfrog: energy is conserved.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gimpmd_gimp.interface import InterfaceEnergy
from gimpmd_gimp.mesh import Mesh
from gimpmd_schemas.grid import PAD, BackgroundGrid, Floats, Ints
from gimpmd_schemas.interface import Interface


class ForceExchange:
    """Ties the nodes of a solver to the atoms by nodal forces.

    Parameters
    ----------
    mesh : Mesh
        Its finest level has the nodes of the shared grid, near the interface at least.
    grid : BackgroundGrid
    interface : Interface
    energy : InterfaceEnergy
        This rank's part of the interface's energy.

    Attributes
    ----------
    offers, needs : ndarray of int64
        Ids, on the shared grid, of the nodes that this rank sends and wants.
    interface_work : float
        Work of the atoms on the nodes so far.
    """

    def __init__(
        self, mesh: Mesh, grid: BackgroundGrid, interface: Interface, energy: InterfaceEnergy
    ) -> None:
        self._energy = energy
        self._nodes = _find(mesh, grid, energy.nodes)
        ghosts = interface.ghost_nodes(grid)
        held = _find(mesh, grid, ghosts)
        own = (held >= 0) & (mesh.counts[held] > 0.0)
        self.offers = self.needs = ghosts[own]
        self._shared = held[own]
        self._U, self._dU = np.zeros((self._nodes.size, 2)), np.zeros((self._shared.size, 2))
        self._force = np.zeros((self._shared.size, 2))
        self.interface_work = 0.0

    def set_displacement(self, u: Floats) -> None:
        """Nodal displacement at the start, shape ``(mesh.size, 2)``."""
        self._U[:] = u[self._nodes]

    def receive(self, fields: Mapping[str, Floats]) -> None:
        """Take the forces of the atoms, ``force`` of shape ``(n, 2)`` on ``needs``, of now."""
        force = fields["force"]
        self.interface_work += 0.5 * float(((self._force + force) * self._dU).sum())
        self._force = np.array(force)

    def add(self, span: float, J: Floats) -> None:
        """Add the impulse of atoms and interface over ``span`` to ``J``, this rank's part."""
        J[self._shared] += span * self._force
        J[self._nodes] += span * self._energy.force(self._U)

    def follow(self, V: Floats, dt: float) -> None:
        """Move on with the nodal velocity of the step, shape ``(mesh.size, 2)``."""
        self._U += dt * V[self._nodes]
        self._dU = dt * V[self._shared]
        self._V = V[self._shared]

    def energy(self) -> float:
        """Energy of this rank's part of the interface now, relative to rest."""
        return self._energy.energy(self._U)

    def zone_fields(self) -> dict[str, Floats]:
        """Nodal velocity of the last step on ``offers``, for the ghost atoms."""
        return {"velocity": self._V}


def _find(mesh: Mesh, grid: BackgroundGrid, ids: Ints) -> Ints:
    """Flat numbers of nodes of the shared grid, -1 for those of other ranks."""
    coords = np.stack(np.unravel_index(ids, grid.shape), axis=1) - PAD
    return mesh.find(mesh.hierarchy.top, coords)

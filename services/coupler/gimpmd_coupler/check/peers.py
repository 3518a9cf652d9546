"""What the other side sends: ideal atoms and an ideal continuum, without motion of their own.

Both act at the ghost atoms of the schemes with planes. In the force scheme the bonds of the crystal
give the forces of a strain, in the sites scheme what LAMMPS has measured. A pulse is a smooth push
along each axis that begins and ends with zero, so that all rules of integration agree on its
impulse.
"""

from __future__ import annotations

from functools import cached_property
from typing import Protocol

import numpy as np

from gimpmd_coupler.check.partner import Fields, Peer
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.case.form import Role, Sites
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.grid.background import PAD
from gimpmd_schemas.grid.planes import Interface
from gimpmd_schemas.mechanics.elasticity import VOIGT
from gimpmd_schemas.mechanics.units import UNITS

PULSE = 20
"""Coupling steps from the beginning of a pulse to its end."""

STRAIN = 1e-4
"""Strain of a pulse (velocity over the speed of longitudinal waves)."""

_ROUNDING = 1e-6
"""Cells by which a site may lie outside a face of the domain and still be meant to lie on it."""


class GhostForces(Protocol):
    """Forces of the free atoms on the nodes, by way of the ghosts (mass length / time^2)."""

    def strained(self, gradient: Floats, nodes: Ints) -> Floats:
        """Forces ``(n, d)`` on nodes at a uniform displacement gradient."""
        ...

    def pushed(self, force: Floats, nodes: Ints) -> Floats:
        """Forces ``(n, d)`` on nodes at rest, with a push ``(d,)`` at many places."""
        ...


def ghost_forces(plan: Plan) -> GhostForces:
    """The forces of the scheme of a plan."""
    sites = plan.coupled.sites
    return Bonds(plan) if sites is None else Measured(sites, plan.dim)


class Measured:
    """Forces of the sites scheme: those at rest, and their derivatives in each strain.

    Parameters
    ----------
    sites : Sites
    dim : int
    """

    def __init__(self, sites: Sites, dim: int) -> None:
        self._ids = np.array(sites.nodes, dtype=np.int64)
        shape = (1 + len(VOIGT[dim]), self._ids.size, dim)
        self._force = np.frombuffer(sites.force, dtype="<f8").reshape(shape)

    def strained(self, gradient: Floats, nodes: Ints) -> Floats:
        """Forces at a small strain: they also turn with the body."""
        rest, *slopes = self._force
        turn = 0.5 * (gradient - gradient.T)
        force = rest + rest @ turn.T
        for (i, j), slope in zip(VOIGT[len(gradient)], slopes, strict=True):
            force = force + slope * (gradient[i, j] + (gradient[j, i] if i != j else 0.0))
        return self._on(nodes, force)

    def pushed(self, force: Floats, nodes: Ints) -> Floats:
        """The push acts on each node that ghosts move."""
        return self._on(nodes, self._force[0] + force)

    def _on(self, nodes: Ints, force: Floats) -> Floats:
        """Forces on nodes, from those on the nodes of the measurement; others have none."""
        found = np.zeros((nodes.size, force.shape[1]))
        _, rows, places = np.intersect1d(nodes, self._ids, return_indices=True)
        found[rows] = force[places]
        return found


class Bonds:
    """Bonds between the free atoms and the ghosts of a crystal at rest.

    Parameters
    ----------
    plan : Plan
        With the crystal and the planes of the force scheme.
    """

    def __init__(self, plan: Plan) -> None:
        crystal = plan.coupled.crystal
        if crystal is None:
            raise ValueError("the plan has no crystal")
        self._grid = plan.background_grid()
        self._vectors, self._origin = np.array(crystal.vectors), np.array(crystal.origin)
        kinds = np.array(crystal.bonds)
        unit = UNITS[plan.units].energy_to_mechanical(1.0)
        degree = max(len(one) for one in crystal.energy)
        energy = [(*one, *(0.0,) * (degree - len(one))) for one in crystal.energy]
        self._energy = unit * np.array(energy)
        ghosts, rods = [], []  # sites of the ghosts, and vectors from them to the free atoms
        numbers = []
        for interface in plan.coupled.interfaces:
            free = self._free(interface)
            for number, kind in enumerate(kinds):
                for rod in (kind, -kind):
                    ghost = free - rod
                    kept = ~interface.free(ghost) & self._exists(ghost)
                    ghosts.append(ghost[kept])
                    rods.append(np.tile(rod, (int(kept.sum()), 1)))
                    numbers.append(np.full(int(kept.sum()), number))
        self._ghosts, self._rods = np.concatenate(ghosts), np.concatenate(rods)
        self._kind = np.concatenate(numbers)

    def nodal(self, force: Floats, nodes: Ints) -> Floats:
        """Forces on nodes from those on the ghost of each bond, shape ``(len(nodes), d)``."""
        dim = self._grid.dim
        sums = np.zeros((self._grid.size, dim))
        cells = (self._ghosts - self._grid.origin) / self._grid.cell
        low = np.floor(cells).astype(np.int64)
        for corner in np.ndindex(*(2,) * dim):
            weight = np.prod(1.0 - np.abs(cells - (low + corner)), axis=1)
            place = low + corner
            for axis, periodic in enumerate(self._grid.periodic):
                if periodic:
                    place[:, axis] %= self._grid.cells[axis]
            rows = np.ravel_multi_index(tuple((place + PAD).T), self._grid.shape)
            np.add.at(sums, rows, weight[:, None] * force)
        return sums[nodes]

    def strained(self, gradient: Floats, nodes: Ints) -> Floats:
        """Forces on nodes; see `forces`."""
        return self.nodal(self.forces(gradient), nodes)

    def pushed(self, force: Floats, nodes: Ints) -> Floats:
        """The push acts on the ghost of each bond."""
        return self.nodal(np.tile(force, (self.count, 1)), nodes)

    def forces(self, gradient: Floats) -> Floats:
        """Forces of the free atoms on the ghost of each bond, at a uniform displacement gradient.

        Forces are in mass length / time^2.
        """
        stretched = self._rods + self._rods @ gradient.T
        square = (self._rods**2).sum(axis=1)
        s = (stretched**2).sum(axis=1) / square - 1.0
        orders = np.arange(self._energy.shape[1])
        slope = (self._energy[self._kind] * (orders + 1) * s[:, None] ** orders).sum(axis=1)
        return (2.0 * slope / square)[:, None] * stretched

    @property
    def count(self) -> int:
        """Number of bonds."""
        return len(self._ghosts)

    def _free(self, interface: Interface) -> Floats:
        """Sites of the free atoms, each once."""
        box = np.array(interface.core())
        corners = np.stack(np.meshgrid(*box, indexing="ij"), axis=-1).reshape(-1, len(box))
        counts = (corners - self._origin) @ np.linalg.inv(self._vectors)
        ranges = [
            np.arange(np.floor(low) - 1, np.ceil(high) + 2)
            for low, high in zip(counts.min(axis=0), counts.max(axis=0), strict=True)
        ]
        numbers = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, len(box))
        sites = self._origin + numbers @ self._vectors
        inside = interface.free(sites) & self._exists(sites)
        for axis, periodic in enumerate(self._grid.periodic):
            if periodic:  # of two sites on opposite faces one exists
                low, margin = self._grid.origin[axis], _ROUNDING * self._grid.cell
                high = low + self._grid.cell * self._grid.cells[axis]
                inside &= (sites[:, axis] >= low - margin) & (sites[:, axis] < high - margin)
        return sites[inside]

    def _exists(self, x: Floats) -> Bools:
        """Whether sites lie in the domain; across a periodic face the crystal goes on."""
        inside, grid = np.ones(len(x), dtype=np.bool_), self._grid
        margin = _ROUNDING * grid.cell
        for axis in range(grid.dim):
            if not grid.periodic[axis]:
                low = grid.origin[axis]
                high = low + grid.cell * grid.cells[axis]
                inside &= (x[:, axis] >= low - margin) & (x[:, axis] <= high + margin)
        return inside


class Ideal:
    """The other side of a service: its fields at a step, in four situations.

    Parameters
    ----------
    plan : Plan
        Coupled by a scheme with planes.
    role : Role
        Role of the service, so the fields are those of the other one.
    nodes : ndarray of int64
        Ids of the nodes that the service needs.
    """

    def __init__(self, plan: Plan, role: Role, nodes: Ints) -> None:
        self._plan, self._role, self._nodes = plan, role, nodes

    @cached_property
    def _ghosts(self) -> GhostForces:
        return ghost_forces(self._plan)

    @property
    def _speed(self) -> float:
        """Speed of a pulse."""
        return STRAIN * self._plan.wave_speed("P")

    def pulse(self, step: int) -> Fields:
        """A push along (1, 0.5, 0.25) that ends after `PULSE` steps."""
        shape = np.sin(np.pi * min(step, PULSE) / PULSE) ** 2
        push = shape / 2.0 ** np.arange(self._plan.dim)
        if self._role == "md":
            return self.motion(self._speed * push)(step)
        # the force that accelerates a cell of the body to the speed in some ten steps
        grid, density = self._plan.background_grid(), self._plan.continuum.material.density
        mass = density * grid.cell**grid.dim
        force = mass * self._speed / (0.5 * PULSE * self._plan.step) * push
        return {"force": self._ghosts.pushed(force, self._nodes)}

    def motion(self, velocity: Floats) -> Peer:
        """All atoms, or all nodes, move with one velocity."""
        if self._role == "md":
            fields: Fields = {"velocity": np.tile(velocity, (self._nodes.size, 1))}
        else:
            fields = self.strained(np.zeros((self._plan.dim,) * 2))(0)
        return lambda step: fields

    def strained(self, gradient: Floats) -> Peer:
        """The body rests with a uniform displacement gradient."""
        if self._role == "md":
            return self.motion(np.zeros(self._plan.dim))
        fields = {"force": self._ghosts.strained(gradient, self._nodes)}
        return lambda step: fields

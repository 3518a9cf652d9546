"""A small MD code: a close-packed lattice of harmonic springs, on one rank, in 2 or 3 dimensions.

It shows all that an MD code must offer (`gimpmd_md.engines.atoms.Atoms`). Its springs join nearest
neighbours and are at rest at the lattice positions, so surfaces are relaxed. In the plane the
lattice is hexagonal, and isotropic with ``lambda = mu = sqrt(3) k / 4``; in space it is
face-centred cubic.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from gimpmd_md.engines.atoms import Spring
from gimpmd_md.roles import BOUNDARY
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.checkpoint.states import SavedStates
from gimpmd_schemas.compiled import njit
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.grid.zones import Box

A = 1.1132013035564605
"""Spacing of atoms, which is also the rest length of the springs."""

KEPT = ("x", "v", "f", "rest", "last", "preload", "external", "potential")
"""Values of the atoms that change during a run."""

K = 27.83316 * 4.0 / 3.0**0.5
"""Stiffness of the springs, in reduced units; the mass of an atom is 1."""


class ToyAtoms:
    """The atoms; see `gimpmd_md.engines.atoms.Atoms`."""

    pairwise = True
    migrations = 0  # atoms never change their order
    cutoff = 1.1 * A
    fix_work, notes = 0.0, ()

    def __init__(self, plan: Plan, comm: Any, run_dir: Path) -> None:
        if comm.size != 1:
            raise BackendError("the toy runs on one rank")
        self._plan, self.comm = plan, comm
        self.site = sites(plan.atoms.region, plan.domain.periodic)
        self.x, self.rest, self.last = (self.site.copy() for _ in range(3))
        self.v, self.f = np.zeros_like(self.site), np.zeros_like(self.site)
        self.external, self.preload = np.zeros_like(self.site), np.zeros_like(self.site)
        self.mass, self.potential = np.ones(len(self.x)), np.zeros(len(self.x))
        self.role = np.zeros(len(self.x), dtype=np.int32)
        self._bonds, self._shifts = springs(self.site, plan.domain.box, plan.domain.periodic)

    @staticmethod
    def version() -> str:
        return "toy 1"

    def settle(
        self,
        springs: Sequence[Spring],
        loaded: int,
        counted: int,
        tolerance: float | None,
        saved: object = None,
    ) -> None:
        self._free = (self.role & BOUNDARY) == 0
        self._loaded = (self.role & loaded) != 0
        self._hold = np.zeros_like(self.x)  # stiffness of the springs of each atom
        for spring in springs:
            self._hold[(self.role & spring.bit) != 0, spring.axis] += spring.stiffness

    def start(self) -> None:
        self.run(0)

    def run(self, steps: int) -> None:
        external = np.where(self._loaded[:, None], self.external, 0.0)
        dt = self._plan.atoms.timestep
        state = (self.x, self.v, self.f, external, self.potential)
        verlet(steps, dt, *state, self._free, self._hold, self.rest, self._bonds, self._shifts)

    def renew(self) -> None:
        """Everything follows from the state."""

    def state(self) -> dict[str, np.ndarray]:
        return {name: getattr(self, name) for name in KEPT}

    def restore(self, saved: SavedStates) -> None:
        for name in KEPT:
            getattr(self, name)[:] = saved.own[name]

    def close(self) -> None:
        pass


def sites(region: Box, periodic: tuple[bool, ...]) -> Floats:
    """Lattice positions in a box; one of them is the origin."""
    if len(region) == 2:  # rectangular cell of the hexagonal lattice
        edges = A * np.array([1.0, 3.0**0.5])
        basis = np.array([[0.0, 0.0], [0.5, 0.5]])
    else:
        edges = A * np.full(3, 2.0**0.5)
        basis = np.array([[0.0, 0.0, 0.0], [0.0, 0.5, 0.5], [0.5, 0.0, 0.5], [0.5, 0.5, 0.0]])
    cells = [
        np.arange(int(np.floor(low / edge)) - 1, int(np.ceil(high / edge)) + 2)
        for (low, high), edge in zip(region, edges, strict=True)
    ]
    corners = np.stack(np.meshgrid(*cells, indexing="ij"), axis=-1).reshape(-1, 1, len(region))
    x = ((corners + basis) * edges).reshape(-1, len(region))
    eps = 1e-6 * A
    inside = np.ones(len(x), dtype=np.bool_)
    for axis, (low, high) in enumerate(region):
        end = high - eps if periodic[axis] else high + eps
        inside &= (x[:, axis] >= low - eps) & (x[:, axis] < end)
    return x[inside]


def springs(x: Floats, box: Box, periodic: tuple[bool, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of nearest neighbours, and what periods add to their distance vectors."""
    size = np.array([high - low for low, high in box])
    low = np.array([low for low, _ in box])
    room = np.where(periodic, size, 4.0 * size)  # not periodic: the images are far away
    pairs = cKDTree((x - low) % room, boxsize=room).query_pairs(1.1 * A, output_type="ndarray")
    d = x[pairs[:, 1]] - x[pairs[:, 0]]
    return pairs, -np.where(periodic, size * np.round(d / size), 0.0)


@njit(cache=True)
def verlet(steps, dt, x, v, f, external, potential, free, hold, rest, bonds, shifts):  # type: ignore[no-untyped-def]
    """Velocity Verlet; on return `f` and `potential` belong to `x`."""
    for step in range(steps + 1):
        f[:] = external - hold * (x - rest)
        potential[:] = 0.0
        for b in range(bonds.shape[0]):
            i, j = bonds[b, 0], bonds[b, 1]
            square = 0.0
            for axis in range(x.shape[1]):
                square += (x[j, axis] - x[i, axis] + shifts[b, axis]) ** 2
            r = np.sqrt(square)
            for axis in range(x.shape[1]):
                pull = K * (r - A) / r * (x[j, axis] - x[i, axis] + shifts[b, axis])
                f[i, axis] += pull
                f[j, axis] -= pull
            energy = 0.25 * K * (r - A) ** 2
            potential[i] += energy
            potential[j] += energy
        for a in range(x.shape[0]):
            for axis in range(x.shape[1]):
                # the two half steps of the velocity around `f`; only one at either end of the run
                half_steps = (step > 0) + (step < steps)
                if free[a]:
                    v[a, axis] += 0.5 * dt * half_steps * f[a, axis]
                if step < steps:
                    x[a, axis] += dt * v[a, axis]

"""A toy continuum code: hyperelasticity with displacements at the nodes of the shared grid.

Bilinear finite elements (total Lagrangian) with lumped masses and leapfrog steps, on one rank and
one level. Elements that a plane of the interface cuts are integrated over the boxes that fill their
part of the continuum. There are no boundary conditions: faces of the domain are free or periodic.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from gimpmd_gimp.coupling.interface.cutting import cut
from gimpmd_gimp.coupling.interface.weights import gradients, hats
from gimpmd_gimp.coupling.solver_protocol import AddImpulse
from gimpmd_gimp.grid.mesh import Mesh
from gimpmd_gimp.laws import make_law
from gimpmd_gimp.points.distribution import fill
from gimpmd_gimp.points.material_points import MaterialPoints
from gimpmd_gimp.setup import make_hierarchy
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.case.initial_state import initial_state
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.checkpoint.states import SavedStates
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.wire.energies import Energies, from_array, to_array


class ToyContinuum:
    """See ``ContinuumSolver``. Rows of nodal arrays are the ids of the shared grid."""

    def __init__(self, plan: Plan, comm: Any, run_dir: Path) -> None:
        if len(plan.level_cells) > 1 or plan.continuum.ranks > 1:
            raise BackendError("the toy continuum knows one level and one rank only")
        self.comm, self.steps, self.dt, self.law = None, 0, plan.step, make_law(plan)
        self._grid = grid = plan.background_grid()
        boxes = fill(Mesh(make_hierarchy(plan)), plan.continuum.points_per_axis, self.law.density)
        for interface in plan.coupling.interfaces if plan.coupling else ():
            boxes = cut(boxes, interface, grid.cell)
        self._boxes = boxes
        self._gradient = gradients(grid, boxes.reference, boxes.half)
        self._mass = np.asarray(hats(grid, boxes.reference).T @ boxes.mass)
        self._inverse = 1.0 / np.where(self._mass > 0.0, self._mass, np.inf)
        self._u, self._v, _ = initial_state(plan, self.positions(np.arange(grid.size)))
        self._u[self._mass == 0.0] = self._v[self._mass == 0.0] = 0.0
        self._forces: list[AddImpulse] = []
        self._noted: Energies | None = None
        self._kinetic, self._momentum = 0.0, np.zeros(grid.dim)

    @staticmethod
    def version() -> str:
        return "toy continuum 1"

    def summary(self) -> str:
        return f"{np.count_nonzero(self._mass)} nodes"

    def rows(self, ids: Ints) -> Ints:
        return ids

    def counted(self, rows: Ints) -> Bools:
        return np.ones(rows.size, dtype=np.bool_)

    def positions(self, rows: Ints) -> Floats:
        return self._grid.positions()[rows]

    def velocity(self, rows: Ints) -> Floats:
        return self._v[rows]

    def owns(self, x: Floats) -> Bools:
        return np.ones(x.shape[0], dtype=np.bool_)

    def add_nodal_forces(self, add: AddImpulse) -> None:
        self._forces.append(add)

    def points_at_rest(self) -> MaterialPoints:
        return self._boxes

    def deformation(self) -> tuple[Floats, Floats]:
        return self._F(), self._boxes.reference

    def start_step(self) -> None:
        """Kick from half step to half step, then move the nodes."""
        kick = self._kick(self.dt if self.steps else 0.5 * self.dt)
        middle = self._v + 0.5 * kick if self.steps else self._v
        self._kinetic, self._momentum = self._motion(middle)
        self._v += kick
        self._u += self.dt * self._v
        self.steps += 1

    def end_step(self) -> None:
        """Nothing is left to do."""

    def prepare(self) -> None:
        """Nothing is known before."""

    def note_energies(self) -> float:
        strain = self._strain_energy()
        self._noted = self._energies(*self._motion(self._v), strain)
        return strain

    def noted_energies(self) -> Energies:
        assert self._noted is not None
        return self._energies(self._kinetic, self._momentum, self._noted.potential)

    def present_energies(self) -> Energies:
        kick = self._kick(0.5 * self.dt) if self.steps else 0.0
        return self._energies(*self._motion(self._v + kick), self._strain_energy())

    def friction(self) -> float:
        return 0.0

    def renew(self) -> None:
        """Everything follows from the state."""

    def state(self) -> dict[str, np.ndarray]:
        noted = {} if self._noted is None else {"total/noted": to_array(self._noted)}
        return {"u": self._u, "v": self._v, "steps": np.asarray(self.steps), **noted}

    def restore(self, saved: SavedStates) -> None:
        self._u, self._v = saved.own["u"], saved.own["v"]
        self.steps = int(saved.own["steps"])
        if saved.has("total/noted"):
            self._noted = from_array(saved.total("noted"))

    def write(self, time: float) -> None:
        """The toy writes nothing."""

    def close(self) -> None:
        """Nothing is open."""

    def _kick(self, span: float) -> Floats:
        """Change of the nodal velocity: ``-sum V stress . grad N`` and the forces from outside."""
        boxes, F, J = self._boxes, self._F(), np.zeros_like(self._u)
        stress = np.zeros_like(F)
        self.law.stress(np.arange(boxes.count), 0, boxes.count, F, boxes.history, stress)
        if self.law.finite:  # the nominal stress
            stress = np.linalg.inv(F) @ stress
        for axis, matrix in enumerate(self._gradient):
            J -= span * (matrix.T @ (boxes.volume[:, None] * stress[:, axis]))
        for add in self._forces:
            add(span, J)
        return self._inverse[:, None] * J

    def _F(self) -> Floats:
        columns = [matrix @ self._u for matrix in self._gradient]
        return np.ascontiguousarray(np.eye(self._grid.dim) + np.stack(columns, axis=2))

    def _strain_energy(self) -> float:
        boxes, density = self._boxes, np.zeros(self._boxes.count)
        self.law.energy(np.arange(boxes.count), 0, boxes.count, self._F(), boxes.history, density)
        return float(boxes.volume @ density)

    def _motion(self, v: Floats) -> tuple[float, Floats]:
        """Kinetic energy and momentum."""
        return 0.5 * float(self._mass @ (v**2).sum(axis=1)), self._mass @ v

    def _energies(self, kinetic: float, momentum: Floats, potential: float) -> Energies:
        return Energies(
            kinetic=kinetic,
            potential=potential,
            external_work=0.0,
            interface_work=0.0,
            dissipated=0.0,
            mass=float(self._mass.sum()),
            momentum=tuple(momentum.tolist()),
        )

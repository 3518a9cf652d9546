"""Finite elements: explicit steps of hyperelastic bodies, from their positions at rest.

Total Lagrangian, lumped masses, leapfrog steps (central differences). Displacements are known at
whole steps, velocities between them.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any, ClassVar

import msgspec
import numpy as np

from gimpmd_gimp.coupling.solver_protocol import AddImpulse
from gimpmd_gimp.fem.body import make_body
from gimpmd_gimp.fem.check_mesh import check_mesh
from gimpmd_gimp.fem.conditions import make_conditions
from gimpmd_gimp.laws import make_law
from gimpmd_gimp.laws.law import is_inelastic
from gimpmd_gimp.output.fields import PointsFile
from gimpmd_gimp.output.writer import point_fields, three
from gimpmd_gimp.points.material_points import MaterialPoints, points_at_rest
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.initial_state import initial_state
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.checkpoint.states import TOTAL, Array, SavedStates
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.mechanics.units import UNITS
from gimpmd_schemas.registry import Abilities
from gimpmd_schemas.wire.energies import Energies


class Fem:
    """The continuum of a run as finite elements, on one process; see ``ContinuumSolver``.

    Rows of nodal arrays are the nodes of the body: the ids of the shared grid, or, with a mesh from
    a file, numbers of its own.

    Parameters
    ----------
    plan : Plan
    comm : None
        There is one rank.
    run_dir : Path
        Quadrature points are written to ``run_dir / "fields" / "points.vtkhdf"``.

    Raises
    ------
    BackendError
        The plan asks for something that only GIMP can do.
    """

    abilities: ClassVar[Abilities] = Abilities(
        dimensions=(2, 3),
        materials="every elastic material of the case file, linear and finite, and crystals",
        schemes=("force",),
        ranks=1,
        checkpoint=True,
    )

    def __init__(self, plan: Plan, comm: Any, run_dir: Path) -> None:
        _refuse(plan)
        self.comm, self.steps, self.dt, self.law = None, 0, plan.step, make_law(plan)
        if is_inelastic(self.law):
            raise BackendError(
                f"continuum.material: {self.law.name} has history variables; continuum.backend: "
                "fem is elastic, so use continuum.backend: gimp"
            )
        self._plan, self._body = plan, make_body(plan, self.law.density, run_dir)
        self._elements, self._nodes = self._body.elements, self._body.nodes
        self._mass = self._elements.lumped_mass(self.law.density)
        self._inverse = 1.0 / np.where(self._mass > 0.0, self._mass, np.inf)[:, None]
        self._tractions, self._motions = make_conditions(plan, self._body, self._mass)
        self._forces: list[AddImpulse] = []
        self._u, self._v, _ = initial_state(plan, self._nodes)
        self._u[self._mass == 0.0] = self._v[self._mass == 0.0] = 0.0
        self._deform()
        self._kinetic, self._momentum = 0.0, np.zeros(plan.dim)
        self._work = self._noted_work = self._noted_strain = 0.0
        self._folder = run_dir / "fields"
        self._file: PointsFile | None = None

    @staticmethod
    def version() -> str:
        """See ``ContinuumSolver``."""
        return f"fem {version('gimpmd')} (scikit-fem {version('scikit-fem')})"

    @staticmethod
    def check_input(case: Case, folder: Path) -> None:
        """Check the mesh of a case before it runs; see `check_mesh`."""
        check_mesh(case, folder)

    def summary(self) -> str:
        """See ``ContinuumSolver``."""
        points, nodes = self._elements.volume.size, np.count_nonzero(self._mass)
        return f"{points:,} quadrature points, {nodes:,} nodes"

    # --- nodes ------------------------------------------------------------------------------

    def rows(self, ids: Ints) -> Ints:
        """See ``ContinuumSolver``."""
        return self._body.row[ids]

    def counted(self, rows: Ints) -> Bools:
        """See ``ContinuumSolver``."""
        return np.ones(rows.size, dtype=np.bool_)

    def positions(self, rows: Ints) -> Floats:
        """See ``ContinuumSolver``."""
        return self._nodes[rows]

    def velocity(self, rows: Ints) -> Floats:
        """See ``ContinuumSolver``."""
        return self._v[rows]

    def owns(self, x: Floats) -> Bools:
        """See ``ContinuumSolver``."""
        return np.ones(x.shape[0], dtype=np.bool_)

    def add_nodal_forces(self, add: AddImpulse) -> None:
        """See ``ContinuumSolver``."""
        self._forces.append(add)

    def points_at_rest(self) -> MaterialPoints:
        """Of the elements of the shared grid; see ``ContinuumSolver``."""
        return self._body.boxes

    def deformation(self) -> tuple[Floats, Floats]:
        """Of the quadrature points; see ``ContinuumSolver``."""
        return self._F, self._elements.reference + self._elements.values @ self._u

    # --- steps ------------------------------------------------------------------------------

    def start_step(self) -> None:
        """Kick the velocity from half step to half step, then move the nodes.

        The energies of the present time have the velocity in the middle of the kick.
        """
        first = not self.steps
        change, loads = self._kick(1.0)
        middle = self._v + 0.5 * change
        self._kinetic, self._momentum = self._motion(self._v if first else middle)
        work = float((loads * middle).sum())
        self._noted_work = self._work + (0.0 if first else 0.5 * work)
        self._work += work
        self._v += change
        self._u += self.dt * self._v
        self.steps += 1

    def end_step(self) -> None:
        """Deform the elements."""
        if self.steps:
            self._deform()

    def prepare(self) -> None:
        """Nothing is left to do: ``end_step`` has summed the forces of the elements."""

    def _deform(self) -> None:
        """Deformation gradients, and the nodal forces ``-sum_p V_p P grad N`` of the elements.

        Raises
        ------
        BackendError
            The body has become unstable.
        """
        elements, law = self._elements, self.law
        columns = [matrix @ self._u for matrix in elements.gradient]
        self._F = np.ascontiguousarray(np.eye(self._plan.dim) + np.stack(columns, axis=2))
        self._check(self._F, "deformations")
        stress = np.zeros_like(self._F)
        law.stress(*self._all_points(), self._F, self._no_history(), stress)
        if law.finite:  # Kirchhoff stress to the transpose of the first Piola-Kirchhoff stress
            stress = np.linalg.solve(self._F, stress)
        self._internal = np.zeros_like(self._u)
        for axis, matrix in enumerate(elements.gradient):
            self._internal -= matrix.T @ (elements.volume[:, None] * stress[:, axis])
        self._check(self._internal, "forces")

    def _check(self, values: Floats, what: str) -> None:
        """Check that the body is stable.

        Raises
        ------
        BackendError
            Values are not finite.
        """
        if not np.isfinite(values).all():
            raise BackendError(
                f"the finite elements became unstable in step {self.steps}: {what} are not "
                "finite; use a shorter time step (time.md_steps or time.step)"
            )

    def _kick(self, share: float) -> tuple[Floats, Floats]:
        """Change of the velocity by a share of the present kick, and the impulse of the loads.

        The kick leads from the middle of the last step, or from the start, to that of the next.
        """
        time, span = self.steps * self.dt, share * (self.dt if self.steps else 0.5 * self.dt)
        loads = np.zeros_like(self._v)
        for traction in self._tractions:
            loads += traction.impulse(time, span)
        impulse = span * self._internal + loads
        for add in self._forces:
            add(span, impulse)
        for motion in self._motions:
            place = motion.nodes, motion.component
            change = share * (motion.velocity(time, self.dt) - self._v[place])
            reaction = self._mass[motion.nodes] * change - impulse[place]
            loads[place] += reaction
            impulse[place] += reaction
        return self._inverse * impulse, loads

    def _all_points(self) -> tuple[Ints, int, int]:
        n = self._elements.volume.size
        return np.arange(n), 0, n

    def _no_history(self) -> Floats:
        return np.empty((self._elements.volume.size, 0))

    # --- results ----------------------------------------------------------------------------

    def note_energies(self) -> float:
        """See ``ContinuumSolver``."""
        self._noted_strain = self._strain_energy()
        return self._noted_strain

    def noted_energies(self) -> Energies:
        """See ``ContinuumSolver``."""
        return self._energies(self._kinetic, self._momentum, self._noted_strain, self._noted_work)

    def present_energies(self) -> Energies:
        """See ``ContinuumSolver``: half a kick leads from the last velocity to the present time."""
        if not self.steps:
            return self._energies(*self._motion(self._v), self._strain_energy(), 0.0)
        change, loads = self._kick(0.5)
        v = self._v + change
        work = self._work + float((loads * v).sum())
        return self._energies(*self._motion(v), self._strain_energy(), work)

    def friction(self) -> float:
        """No faces are in contact."""
        return 0.0

    # --- checkpoints ------------------------------------------------------------------------

    def renew(self) -> None:
        """Everything follows from the state already."""

    def state(self) -> dict[str, Array]:
        """Motion of the nodes, work, strain energy as noted, and the lengths of the file."""
        lengths = {} if self._file is None else self._file.lengths()
        return {
            "steps": np.asarray(self.steps),
            "displacement": self._u,
            "velocity": self._v,
            "output/lengths": np.frombuffer(msgspec.json.encode(lengths), np.uint8),
            TOTAL + "external_work": np.asarray(self._work),
            TOTAL + "noted_strain": np.asarray(self._noted_strain),
        }

    def restore(self, saved: SavedStates) -> None:
        """See ``ContinuumSolver``."""
        own = saved.own
        self.steps, self._u, self._v = int(own["steps"]), own["displacement"], own["velocity"]
        if self._u.shape != self._nodes.shape:
            raise BackendError(
                f"the checkpoint of step {saved.step} has {len(self._u)} nodes, but the body has "
                f"{len(self._nodes)}: it belongs to another case"
            )
        self._work, self._noted_strain = (
            float(saved.total(name)) for name in ("external_work", "noted_strain")
        )
        self._deform()
        if lengths := msgspec.json.decode(own["output/lengths"].tobytes(), type=dict[str, int]):
            self._open(lengths)

    # --- output -----------------------------------------------------------------------------

    def write(self, time: float) -> None:
        """Append the boxes of the quadrature points, with the fields of material points.

        Strain and stress are those at the quadrature points.
        """
        elements, density = self._elements, self.law.density
        level = np.zeros(elements.volume.size, dtype=np.int32)
        p = points_at_rest(elements.reference, elements.volume, density, elements.half, level)
        at_centres = elements.at_reference
        p.x, p.v, p.F = p.x + at_centres @ self._u, at_centres @ self._v, self._F
        size = 2.0 * self._plan.finest_cell * elements.half
        file = self._file or self._open()
        file.append(time, three(p.x), point_fields(p, size, self.law, self._plan))

    def close(self) -> None:
        """See ``ContinuumSolver``."""
        if self._file is not None:
            self._file.close()

    def _open(self, lengths: Mapping[str, int] | None = None) -> PointsFile:
        """Begin the file of points, or go on with an earlier one."""
        self._folder.mkdir(exist_ok=True)
        units = UNITS[self._plan.units]
        attributes = {"length": units.length, "time": units.time, "stress": units.pressure}
        self._file = PointsFile(self._folder / "points.vtkhdf", attributes, lengths)
        return self._file

    def _strain_energy(self) -> float:
        density = np.zeros(self._elements.volume.size)
        self.law.energy(*self._all_points(), self._F, self._no_history(), density)
        return float(self._elements.volume @ density)

    def _motion(self, v: Floats) -> tuple[float, Floats]:
        """Kinetic energy and momentum."""
        return 0.5 * float(self._mass @ (v**2).sum(axis=1)), self._mass @ v

    def _energies(
        self, kinetic: float, momentum: Floats, potential: float, work: float
    ) -> Energies:
        return Energies(
            kinetic=kinetic,
            potential=potential,
            external_work=work,
            interface_work=0.0,
            dissipated=0.0,
            mass=float(self._mass.sum()),
            momentum=tuple(momentum.tolist()),
        )


def _refuse(plan: Plan) -> None:
    """Refuse what only GIMP can do.

    Raises
    ------
    BackendError
    """
    continuum = plan.continuum
    for key, asked in (
        ("grid.levels", len(plan.level_cells) > 1),
        ("continuum.ranks", continuum.ranks > 1),
        # in a coupled run the atoms hold the cracks
        ("continuum.cracks", bool(continuum.cracks) and plan.coupling is None),
        ("continuum.damping", bool(continuum.damping)),
        ("continuum.flip", continuum.flip < 1.0),
        ("continuum.body_force", continuum.body_force is not None),
        ("output.nodes", plan.write_nodes),
    ):
        if asked:
            raise BackendError(
                f"{key}: continuum.backend: fem has none of this; leave the key out, or use "
                "continuum.backend: gimp"
            )

"""GIMP as a continuum code: the ``ContinuumSolver`` that the name ``gimp`` stands for."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from msgspec.structs import replace

from gimpmd_gimp.boundary.nodal_forces import NodalForces
from gimpmd_gimp.coupling.nodes import find_nodes
from gimpmd_gimp.coupling.sites.layout import lay_out
from gimpmd_gimp.coupling.sites.memory import check_room, size_of_correction
from gimpmd_gimp.coupling.solver_protocol import AddImpulse
from gimpmd_gimp.laws import Law
from gimpmd_gimp.output import checkpoint
from gimpmd_gimp.output.writer import Writer
from gimpmd_gimp.points.distribution import nearest_patch
from gimpmd_gimp.points.groups import ALL
from gimpmd_gimp.points.material_points import MaterialPoints
from gimpmd_gimp.setup import make_solver
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.checkpoint.states import TOTAL, Array, SavedStates
from gimpmd_schemas.registry import Abilities
from gimpmd_schemas.wire.energies import Energies, from_array, to_array


class Gimp:
    """GIMP on one rank; see ``ContinuumSolver``.

    Parameters
    ----------
    plan : Plan
    comm : mpi4py communicator or None
        With ``plan.continuum.ranks`` ranks.
    run_dir : Path
        Fields are written to ``run_dir / "fields"`` by the first rank.

    Attributes
    ----------
    solver : Solver
    layout : Layout or None
        Of the interface in the sites scheme, whose slaves are constraints of the mesh.
    """

    abilities: ClassVar[Abilities] = Abilities(
        dimensions=(2, 3),
        materials="every material of the case file, as linear and finite elasticity, crystals and "
        "von Mises plasticity",
        schemes=("force", "sites", "velocity", "paper"),
        ranks=None,
        checkpoint=True,
    )

    def __init__(self, plan: Plan, comm: Any, run_dir: Path) -> None:
        self.comm, self._grid = comm, plan.background_grid() if plan.coupling else None
        by_sites = plan.coupling is not None and plan.coupling.scheme == "sites"
        self.layout = lay_out(plan) if by_sites else None
        self.solver = make_solver(plan, comm, self.layout)
        if self.layout is not None:
            check_room(size_of_correction(self.layout), comm)
        self._writer = Writer(plan, run_dir, self.solver)
        self._noted: Energies | None = None

    @staticmethod
    def version() -> str:
        """See ``ContinuumSolver``."""
        return f"gimp {version('gimpmd')}"

    @property
    def steps(self) -> int:
        """See ``ContinuumSolver``."""
        return self.solver.steps

    @property
    def dt(self) -> float:
        """See ``ContinuumSolver``."""
        return self.solver.dt

    @property
    def law(self) -> Law:
        """See ``ContinuumSolver``."""
        return self.solver.law

    def summary(self) -> str:
        """Material points and nodes of every level on this rank."""
        p, mesh = self.solver.points, self.solver.mesh
        levels = [
            f"level {level}: {np.count_nonzero(p.level == level):,} material points, "
            f"{np.count_nonzero(mesh.level == level):,} nodes"
            for level in range(self.solver.top + 1)
        ]
        return f"rank {mesh.rank} of {mesh.ranks}; {'; '.join(levels)}"

    # --- nodes ------------------------------------------------------------------------------

    def rows(self, ids: Ints) -> Ints:
        """See ``ContinuumSolver``."""
        if self._grid is None:
            raise ValueError("a run without atoms has no shared grid")
        return find_nodes(self.solver, self._grid, ids)

    def counted(self, rows: Ints) -> Bools:
        """See ``ContinuumSolver``."""
        return self.solver.mesh.counts[rows] > 0.0

    def positions(self, rows: Ints) -> Floats:
        """See ``ContinuumSolver``."""
        return self.solver.mesh.positions()[rows]

    def velocity(self, rows: Ints) -> Floats:
        """See ``ContinuumSolver``."""
        return np.take(self.solver.V, rows, axis=0)

    def owns(self, x: Floats) -> Bools:
        """See ``ContinuumSolver``."""
        mesh = self.solver.mesh
        return nearest_patch(mesh, mesh.hierarchy.top, x)[0] == mesh.rank

    def add_nodal_forces(self, add: AddImpulse) -> None:
        """See ``ContinuumSolver``."""
        self.solver.add_condition(NodalForces(add))

    def points_at_rest(self) -> MaterialPoints:
        """See ``ContinuumSolver``."""
        return self.solver.points

    def deformation(self) -> tuple[Floats, Floats]:
        """See ``ContinuumSolver``."""
        return self.solver.points.F, self.solver.points.x

    # --- steps ------------------------------------------------------------------------------

    def start_step(self) -> None:
        """See ``ContinuumSolver``."""
        self.solver.start_step()

    def end_step(self) -> None:
        """See ``ContinuumSolver``."""
        self.solver.end_step()

    def prepare(self) -> None:
        """See ``ContinuumSolver``."""
        self.solver.prepare()

    # --- results ----------------------------------------------------------------------------

    def note_energies(self) -> float:
        """See ``ContinuumSolver``."""
        solver = self.solver
        strain, mass = solver.strain_energy().tolist()
        self._noted = Energies(
            kinetic=np.nan,
            potential=strain,
            external_work=solver.work.external,
            interface_work=0.0,
            dissipated=solver.dissipation(),
            mass=mass,
            momentum=(),
        )
        self._noted_at_start = solver.steps == 0
        return float(strain)

    def noted_energies(self) -> Energies:
        """See ``ContinuumSolver``; exact with MUSL, whose kick has its middle at the noted time."""
        if self._noted is None:
            raise ValueError("no energies have been noted")
        kinetic, *momentum = self.solver.stages.kick_sums.tolist()
        before, after = self._noted.external_work, self.solver.work.external
        work = before if self._noted_at_start else 0.5 * (before + after)
        return replace(self._noted, kinetic=kinetic, momentum=tuple(momentum), external_work=work)

    def present_energies(self) -> Energies:
        """See ``ContinuumSolver``."""
        return self.solver.tally(ALL)

    def friction(self) -> float:
        """See ``ContinuumSolver``."""
        return sum((condition.dissipated for condition in self.solver.conditions), 0.0)

    # --- checkpoints ------------------------------------------------------------------------

    def renew(self) -> None:
        """See ``ContinuumSolver``."""
        checkpoint.renew(self.solver)

    def state(self) -> dict[str, Array]:
        """See ``ContinuumSolver``."""
        found = checkpoint.state(self.solver) | self._writer.state()
        if self._noted is not None:
            found[TOTAL + "noted"] = to_array(self._noted)
        return found

    def restore(self, saved: SavedStates) -> None:
        """See ``ContinuumSolver``."""
        checkpoint.restore(self.solver, saved)
        self._writer.restore(saved)
        if saved.has(TOTAL + "noted"):
            self._noted, self._noted_at_start = from_array(saved.total("noted")), False

    # --- output -----------------------------------------------------------------------------

    def write(self, time: float) -> None:
        """See ``ContinuumSolver``."""
        self._writer.write(time)

    def close(self) -> None:
        """See ``ContinuumSolver``."""
        self._writer.close()

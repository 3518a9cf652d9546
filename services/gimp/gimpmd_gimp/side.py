"""The continuum's side of the coupling, on one rank: one coupling step with any continuum code."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec.structs import replace

from gimpmd_coupler.loop import Timings
from gimpmd_gimp.coupling.force import ForceScheme
from gimpmd_gimp.coupling.monitors import Monitors
from gimpmd_gimp.coupling.scheme import Scheme, Uncoupled
from gimpmd_gimp.coupling.solver_protocol import ContinuumSolver
from gimpmd_gimp.coupling.velocity import CORRECTIONS, VelocityScheme
from gimpmd_gimp.step.solver import Solver
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.form import AT_PLANES
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.checkpoint.states import Array, SavedStates
from gimpmd_schemas.errors import BackendError
from gimpmd_schemas.mechanics.units import UNITS
from gimpmd_schemas.wire.energies import Energies
from gimpmd_schemas.wire.findings import Finding, monitors_look


class ContinuumSide:
    """The continuum of one rank in a run; implements ``gimpmd_coupler.loop.Side``.

    Parameters
    ----------
    plan : Plan
    solver : ContinuumSolver
        In its initial state. The side closes it.

    Attributes
    ----------
    offers, needs : ndarray of int64
        Ids, on the shared grid, of the nodes whose fields this rank sends and receives.
    timings : Timings
        Wall times of the phases of this side.
    notes : tuple of str
        What the user should know of the interface.

    Raises
    ------
    BackendError
        The code does not support the coupling scheme.
    """

    def __init__(self, plan: Plan, solver: ContinuumSolver) -> None:
        self._solver, self._units = solver, UNITS[plan.units]
        self._scheme = make_scheme(plan, solver)
        self._plan, self._monitors = plan, Monitors(plan, solver)
        self._looks = False  # whether monitors look at the step of the last `finish`
        self._strained: tuple[Finding, ...] = ()  # findings about points
        self._energies: Energies | None = None
        self.offers, self.needs = self._scheme.offers, self._scheme.needs
        self.notes = self._scheme.notes
        self.timings = Timings()

    def zone_fields(self) -> Mapping[str, Floats]:
        """Nodal velocity on ``offers``, for the atoms that follow the grid."""
        return self._scheme.zone_fields()

    def finish(self) -> None:
        """Complete the step: all work that the atoms do not wait for."""
        with self.timings.phase("finish"):
            self._scheme.finish()
        self._look()

    def write(self, time: float) -> None:
        """Append the present state to the output files; collective."""
        self._solver.write(time)

    def receive(self, fields: Mapping[str, Floats]) -> None:
        """Hand the fields of the atoms to the scheme, if there are any."""
        with self.timings.phase("receive"):
            if fields:
                self._scheme.receive(fields)

    def advance(self) -> None:
        """Take a step as far as the atoms need it."""
        with self.timings.phase("step"):
            self._scheme.advance()

    def energies(self) -> Energies | None:
        """Conserved quantities at the time of the last ``finish``, in the units of the case."""
        found, unit = self._scheme.energies(), self._units.energy_from_mechanical
        self._energies = found and replace(
            found,
            kinetic=unit(found.kinetic),
            potential=unit(found.potential),
            external_work=unit(found.external_work),
            interface_work=unit(found.interface_work),
            dissipated=unit(found.dissipated + self._solver.friction()),
        )
        return self._energies

    def findings(self) -> tuple[Finding, ...]:
        """What the monitors found at the step of the last `energies`; collective."""
        if self._energies is None or not self._looks:
            return ()
        with self.timings.phase("monitors"):
            found = self._strained + self._monitors.look_at_sums(self._energies)
        return found + self._scheme.misfit()

    def renew(self) -> None:
        """Let the code compute anew what a saved state does not hold; collective."""
        self._solver.renew()

    def state(self) -> dict[str, Array]:
        """State of the code and of the scheme."""
        return self._solver.state() | self._scheme.state() | self._monitors.state()

    def restore(self, saved: SavedStates) -> None:
        """Go on from a checkpoint; collective.

        Raises
        ------
        BackendError
            The state does not fit the plan.
        """
        self._solver.restore(saved)
        self._scheme.restore(saved)
        self._monitors.restore(saved.any)
        self._look()

    def _look(self) -> None:
        """Let the monitors look at the points, if it is time."""
        self._looks = monitors_look(self._plan, self._solver.steps)
        if self._looks:
            with self.timings.phase("monitors"):
                self._strained = self._monitors.look_at_points()

    def close(self) -> None:
        """Close the code and its files."""
        self._solver.close()


def make_scheme(plan: Plan, code: ContinuumSolver) -> Scheme:
    """The coupling scheme of a plan; collective.

    Raises
    ------
    BackendError
        The scheme needs material points or slaves of nodes, and the code has none.
    """
    coupling = plan.coupling
    if coupling is None:
        return Uncoupled(code, plan.energies_every)
    if coupling.scheme in AT_PLANES:
        layout = getattr(code, "layout", None)
        if coupling.scheme == "sites" and layout is None:
            raise BackendError(
                "coupling.scheme = 'sites' ties nodes of GIMP to others, but continuum.backend = "
                f"{plan.continuum.backend!r} cannot do this; set coupling.scheme: force or "
                "continuum.backend: gimp"
            )
        return ForceScheme(plan, code, layout)
    solver = getattr(code, "solver", None)
    if not isinstance(solver, Solver):
        raise BackendError(
            f"coupling.scheme = {coupling.scheme!r} moves the material points of GIMP, but "
            f"continuum.backend = {plan.continuum.backend!r} has none; set coupling.scheme: force "
            "or continuum.backend: gimp"
        )
    return VelocityScheme(
        solver,
        plan.background_grid(),
        coupling.zones,
        coupling.filter_rate,
        plan.energies_every,
        0 if coupling.scheme == "paper" else CORRECTIONS,
    )

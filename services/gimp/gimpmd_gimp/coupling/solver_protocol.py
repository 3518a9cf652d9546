"""What gimpmd asks of a continuum code.

``gimpmd_gimp.side.ContinuumSide`` does everything else of a coupling step. A new continuum code is
a class with this interface, and an entry point that names it (``gimpmd_schemas.registry``)::

    [project.entry-points."gimpmd.continuum"]
    mycode = "mypackage.solver:MySolver"

The code works with explicit time steps, and its unknowns at the interface are the nodes of the
background grid that both sides share. It needs nothing more for a run of its own and for the force
scheme. The velocity schemes move material points with the atoms, so they need GIMP itself.

All quantities are in mechanical units: mass, length and time of the unit style, so that
``F = m a`` needs no factor.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from gimpmd_gimp.laws import Law
from gimpmd_gimp.points.material_points import MaterialPoints
from gimpmd_schemas.arrays import Bools, Floats, Ints
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.checkpoint.states import Array, SavedStates
from gimpmd_schemas.wire.energies import Energies

AddImpulse = Callable[[float, Floats], None]
"""``add(span, J)`` adds an impulse over a span of time to nodal sums ``J`` of shape ``(size, d)``.
Ranks that share a node each add their own part."""


class ContinuumSolver(Protocol):
    """The continuum on one rank, in d dimensions.

    The side calls ``start_step``, ``end_step``, ``note_energies`` (if energies are due) and
    ``prepare`` in this order in every coupling step. The nodes have *rows* in the nodal arrays of
    the code; their number and order are its own.

    Attributes
    ----------
    comm : mpi4py communicator or None
        None for a program of one process.
    """

    comm: Any

    def __init__(self, plan: Plan, comm: Any, run_dir: Path) -> None:
        """Make the continuum in its initial state.

        Parameters
        ----------
        plan : Plan
        comm : mpi4py communicator or None
            With ``plan.continuum.ranks`` ranks.
        run_dir : Path
            Folder of the run. Output goes to ``fields/`` in it.

        Raises
        ------
        BackendError
            The code cannot run this plan.
        """

    @staticmethod
    def version() -> str:
        """Name and version of the code, for the records of the run."""
        ...

    @property
    def steps(self) -> int:
        """Steps so far; one for each coupling step."""
        ...

    @property
    def dt(self) -> float:
        """Time step, that of the coupling."""
        ...

    @property
    def law(self) -> Law:
        """The material."""
        ...

    def summary(self) -> str:
        """Describe what this rank works on, for the log."""
        ...

    # --- nodes ------------------------------------------------------------------------------

    def rows(self, ids: Ints) -> Ints:
        """Rows of nodes of the shared grid, by their ids there; -1 for nodes of other ranks."""
        ...

    def counted(self, rows: Ints) -> Bools:
        """Which of these nodes this rank counts, where several ranks hold a node."""
        ...

    def positions(self, rows: Ints) -> Floats:
        """Positions of nodes at rest, shape ``(n, d)``."""
        ...

    def velocity(self, rows: Ints) -> Floats:
        """Nodal velocity of the last step, shape ``(n, d)``: displacement in the step over ``dt``.

        Valid from ``start_step`` on.
        """
        ...

    def owns(self, x: Floats) -> Bools:
        """Which positions ``(n, d)`` belong to the patch of this rank."""
        ...

    def add_nodal_forces(self, add: AddImpulse) -> None:
        """Let forces act on the nodes in every step; the code calls ``add`` when it sums forces."""
        ...

    def points_at_rest(self) -> MaterialPoints:
        """Small boxes that fill this rank's part of the continuum up to the planes.

        Of each box the force scheme reads the id, the reference position, the half-widths in cells
        and the volume. A code without material points can make them with
        ``points.distribution.fill`` and ``coupling.interface.cutting.cut``.
        """
        ...

    def deformation(self) -> tuple[Floats, Floats]:
        """Deformation gradients ``(n, d, d)`` of points of this rank, and their present positions.

        For the monitor of strains, after ``end_step``. A code without a deformation gradient
        returns no points, and its strains are not watched.
        """
        ...

    # --- steps ------------------------------------------------------------------------------

    def start_step(self) -> None:
        """Take a step as far as its nodal velocity, for which the atoms wait."""
        ...

    def end_step(self) -> None:
        """Complete the step; does nothing before the first one."""
        ...

    def prepare(self) -> None:
        """Compute what the next step can know before the forces of the atoms arrive."""
        ...

    # --- results ----------------------------------------------------------------------------

    def note_energies(self) -> float:
        """Note what the energies at the present time need; returns the strain energy.

        Called after ``end_step``.
        """
        ...

    def noted_energies(self) -> Energies:
        """Energies at the time of ``note_energies``, on this rank; called after ``start_step``.

        Velocities of leapfrog schemes are known only there. The interface work is left zero.
        """
        ...

    def present_energies(self) -> Energies:
        """Energies now, on this rank; collective. The interface work is left zero."""
        ...

    def friction(self) -> float:
        """Energy that friction of faces in contact has turned into heat so far, on this rank."""
        ...

    # --- checkpoints ------------------------------------------------------------------------

    def renew(self) -> None:
        """Compute everything that ``state`` does not hold from what it holds; collective.

        Called after ``end_step`` and before the next ``start_step``, when all levels stand. A run
        that goes on from the state then has the same bits as this one.
        """
        ...

    def state(self) -> dict[str, Array]:
        """All that this rank needs to go on, after ``renew``, by names of its own.

        Names that begin with ``total/`` are amounts that add up over the ranks.
        """
        ...

    def restore(self, saved: SavedStates) -> None:
        """Go on from a saved state, with the output as it was then; collective.

        Called instead of the first step.

        Raises
        ------
        BackendError
            The state does not fit the plan.
        """
        ...

    # --- output -----------------------------------------------------------------------------

    def write(self, time: float) -> None:
        """Append the present state to the output files; collective."""
        ...

    def close(self) -> None:
        """Close the output files."""
        ...

"""What a coupling scheme does in a coupling step, and the run without atoms."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from gimpmd_gimp.coupling.solver_protocol import ContinuumSolver
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.checkpoint.states import TOTAL, Array, SavedStates
from gimpmd_schemas.wire.energies import Energies, from_array, to_array
from gimpmd_schemas.wire.findings import Finding


class Scheme(Protocol):
    """A coupling scheme on the continuum's side.

    A coupling step calls ``zone_fields``, ``finish``, ``receive``, ``advance`` and ``energies`` in
    this order. At the last step there is no ``advance``.

    Attributes
    ----------
    offers, needs : ndarray of int64
        Ids, on the shared grid, of the nodes whose fields this rank sends and receives.
    notes : tuple of str
        What the user should know of the interface.
    """

    offers: Ints
    needs: Ints
    notes: tuple[str, ...]

    def zone_fields(self) -> dict[str, Floats]:
        """Fields on ``offers`` of the step that ended now."""
        ...

    def finish(self) -> None:
        """Complete the step: all work that can wait until the fields are sent."""
        ...

    def receive(self, fields: Mapping[str, Floats]) -> None:
        """Take the fields of the atoms on ``needs``."""
        ...

    def advance(self) -> None:
        """Take a step as far as the next ``zone_fields`` need it."""
        ...

    def energies(self) -> Energies | None:
        """Energies at the time of the last ``finish``, in mechanical units, on this rank.

        Asked for after ``advance``, or after ``receive`` at the last step. None at steps without
        energies. Friction of faces in contact is not included.
        """
        ...

    def state(self) -> dict[str, Array]:
        """What the scheme itself needs to go on after ``finish``; see ``checkpoint.states``."""
        ...

    def restore(self, saved: SavedStates) -> None:
        """Go on from a checkpoint, after the continuum code has been restored."""
        ...

    def misfit(self) -> tuple[Finding, ...]:
        """The finding that the two sides are different materials, if they are."""
        ...


class Uncoupled:
    """A continuum without atoms.

    Parameters
    ----------
    solver : ContinuumSolver
    every : int
        Steps between two times with energies.
    """

    notes: tuple[str, ...] = ()

    def __init__(self, solver: ContinuumSolver, every: int) -> None:
        self._solver, self._every = solver, every
        self._energies: Energies | None = None
        self.offers = self.needs = np.empty(0, dtype=np.int64)

    def zone_fields(self) -> dict[str, Floats]:
        """No fields: there are no atoms."""
        return {}

    def finish(self) -> None:
        """Sum the energies."""
        due = self._solver.steps % self._every == 0
        self._energies = self._solver.present_energies() if due else None

    def receive(self, fields: Mapping[str, Floats]) -> None:
        """Do nothing: there are no atoms."""

    def advance(self) -> None:
        """Take a step."""
        self._solver.start_step()
        self._solver.end_step()

    def energies(self) -> Energies | None:
        """Energies of the last ``finish``; see ``Scheme``."""
        return self._energies

    def state(self) -> dict[str, Array]:
        """Energies to report."""
        return {} if self._energies is None else {TOTAL + "energies": to_array(self._energies)}

    def restore(self, saved: SavedStates) -> None:
        """Take the energies to report."""
        due = self._solver.steps % self._every == 0
        self._energies = from_array(saved.total("energies")) if due else None

    def misfit(self) -> tuple[Finding, ...]:
        """No finding: there are no atoms."""
        return ()

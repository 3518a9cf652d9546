"""How the continuum takes part in a run: what a coupling scheme must offer, and the run alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, Protocol

import numpy as np

from gimpmd_gimp.step.solver import Solver
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.grid.background import PAD, BackgroundGrid


class Books(NamedTuple):
    """Sums over this rank's points that count for the continuum, mechanical units.

    ``external_work`` and ``interface_work`` are those of loads and of the atoms so far, and
    ``dissipated`` is what the law has dissipated so far.
    """

    kinetic: float
    strain: float
    mass: float
    momentum: tuple[float, ...]
    external_work: float
    interface_work: float
    dissipated: float


class Exchange(Protocol):
    """A coupling scheme on the continuum's side, tied to a solver.

    Attributes
    ----------
    offers, needs : ndarray of int64
        Ids, on the shared grid, of the nodes that this rank sends and wants.
    """

    offers: Ints
    needs: Ints

    def zone_fields(self) -> dict[str, Floats]:
        """Fields on ``offers``, of the step that ended now."""
        ...

    def finish(self) -> None:
        """What can wait until the fields are sent."""
        ...

    def receive(self, fields: Mapping[str, Floats]) -> None:
        """Take the atoms' fields on ``needs``."""
        ...

    def advance(self) -> None:
        """Take a step."""
        ...

    def books(self) -> Books | None:
        """Sums at the time of the last ``finish``, once it is ``receive`` and ``advance`` since.

        At the stop no step follows. None between the times at which energies are wanted.
        """
        ...

    def dissipated(self) -> float:
        """Energy that the exchange has taken from this rank's points on purpose so far."""
        ...


class Alone:
    """The continuum without atoms.

    Parameters
    ----------
    solver : Solver
    every : int
        Steps between the times at which energies are wanted.
    """

    def __init__(self, solver: Solver, every: int) -> None:
        self._solver, self._every = solver, every
        self._books: Books | None = None
        self.offers = self.needs = np.empty(0, dtype=np.int64)

    def zone_fields(self) -> dict[str, Floats]:
        """Nothing: nobody listens."""
        return {}

    def finish(self) -> None:
        """Sum up, exactly."""
        self._books = sum_up(self._solver, "all", self._every, exact=True)

    def receive(self, fields: Mapping[str, Floats]) -> None:
        """Nothing comes."""

    def advance(self) -> None:
        """Take a step of GIMP."""
        self._solver.step()

    def books(self) -> Books | None:
        """Sums of the last ``finish``."""
        return self._books

    def dissipated(self) -> float:
        """Nothing."""
        return 0.0


def sum_up(solver: Solver, group: str, every: int, exact: bool) -> Books | None:
    """Books of a group of points now, if so many steps have passed; see ``Solver.energies``."""
    if solver.steps % every:
        return None
    kinetic, strain, mass, *momentum = solver.energies(group, exact=exact).tolist()
    works = solver.work_now, solver.interface_work
    return Books(kinetic, strain, mass, tuple(momentum), *works, solver.dissipation(group))


def find_nodes(solver: Solver, grid: BackgroundGrid, ids: Ints) -> Ints:
    """The solver's nodes of ids of the shared grid, -1 for those of other ranks."""
    coords = np.stack(np.unravel_index(ids, grid.shape), axis=1) - PAD
    return solver.mesh.find(solver.top, coords)

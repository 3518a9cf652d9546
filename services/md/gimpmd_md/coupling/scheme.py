"""What a coupling scheme does for the atoms: their roles, and the fields of the interface."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from gimpmd_md.engines.atoms import Array, Atoms
from gimpmd_md.roles import CORE
from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.case.initial_state import initial_state
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.checkpoint.states import SavedStates


class Scheme(Protocol):
    """One patch's part of a coupling scheme, made when the atoms are at their lattice positions.

    Attributes
    ----------
    offers, needs : ndarray of int64, shapes ``(n,)`` and ``(m,)``
        Ids of the nodes whose fields this rank sends and receives.
    bonded : int
        Role bits of the atoms whose potential energy counts.
    sees_paths : bool
        Whether `fields` reads ``atoms.last`` of all atoms. If not, only loaded atoms have it.
    dissipated : float
        Energy that the scheme has taken out of the atoms of this rank on purpose since the start,
        and out of nodes of the continuum (energy units).
    work_of_nodes : float
        The part of it that came from nodes of the continuum, by another way than ghost atoms.
    """

    @property
    def offers(self) -> Ints:
        """Nodes whose fields this rank sends."""
        ...

    @property
    def needs(self) -> Ints:
        """Nodes whose fields this rank receives."""
        ...

    @property
    def bonded(self) -> int:
        """Role bits of the atoms whose potential energy counts."""
        ...

    @property
    def sees_paths(self) -> bool:
        """Whether `fields` reads ``atoms.last``."""
        ...

    @property
    def dissipated(self) -> float:
        """Energy taken out on purpose."""
        ...

    @property
    def work_of_nodes(self) -> float:
        """The part of it that came from nodes."""
        ...

    def roles(self) -> Ints:
        """Role bits of the atoms by their lattice positions, shape ``(n,)``; collective.

        Raises
        ------
        BackendError
            The atoms do not suit the scheme.
        """
        ...

    def initial_state(self) -> tuple[Floats, Floats]:
        """Displacement from rest and velocity of every atom at the start, both ``(n, d)``."""
        ...

    def drive(self, velocity: Floats) -> None:
        """Give the boundary atoms their velocities for the coupling step that begins; collective.

        Parameters
        ----------
        velocity : ndarray, shape ``(len(needs), d)``
            Velocities of the nodes.

        Raises
        ------
        BackendError
            An atom has left the nodes that the continuum sends.
        """

    def fields(self, span: float) -> dict[str, Floats]:
        """Fields of the scheme on ``offers``; collective.

        Parameters
        ----------
        span : float
            Length of the coupling step that has ended, since which ``atoms.last`` holds the
            positions at its start; 0 at the start of the run.
        """
        ...

    def state(self) -> dict[str, Array]:
        """What the scheme itself needs to go on from here; see `checkpoint.states`."""
        ...

    def restore(self, saved: SavedStates) -> None:
        """Go on from a checkpoint, after the atoms have been restored."""


class Uncoupled:
    """The scheme of a run without a continuum: all atoms are free, and no fields are exchanged.

    Parameters
    ----------
    plan : Plan
    atoms : Atoms
    """

    bonded, sees_paths = CORE, False
    dissipated = work_of_nodes = 0.0

    def __init__(self, plan: Plan, atoms: Atoms) -> None:
        self._plan, self._atoms = plan, atoms
        self.offers = self.needs = np.empty(0, dtype=np.int64)

    def roles(self) -> Ints:
        """All atoms count."""
        return np.full(len(self._atoms.site), CORE)

    def initial_state(self) -> tuple[Floats, Floats]:
        """The initial state of the case."""
        u, v, _ = initial_state(self._plan, self._atoms.rest)
        return u, v

    def drive(self, velocity: Floats) -> None:
        """Do nothing: there are no boundary atoms."""

    def fields(self, span: float) -> dict[str, Floats]:
        """No fields."""
        return {}

    def state(self) -> dict[str, Array]:
        """Nothing of its own."""
        return {}

    def restore(self, saved: SavedStates) -> None:
        """Nothing to take."""

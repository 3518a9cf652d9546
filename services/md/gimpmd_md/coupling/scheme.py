"""What a coupling scheme is to the atoms: who plays which part, and what crosses the interface."""

from __future__ import annotations

from typing import Protocol

from gimpmd_schemas.arrays import Floats, Ints

BOUNDARY, CORE, PROJECTED = 1, 2, 4
"""Bits of ``i_gimpmd_part``: moves with the grid; mass and kinetic energy count; its motion is
projected on nodes.

Further bits, from 8 on, are the backend's own.
"""


class Exchange(Protocol):
    """One patch's side of a coupling scheme; made once the atoms stand at their lattice positions.

    Attributes
    ----------
    offers, needs : ndarray of int64
        Ids of the nodes whose fields this rank gives and wants.
    bonded : int
        Bits of the atoms whose potential energy counts.
    """

    offers: Ints
    needs: Ints
    bonded: int

    def parts(self, x: Floats) -> Ints:
        """Bits of atoms by their lattice positions, shape ``(n, 2)``; collective."""
        ...

    def initial_state(self) -> tuple[Floats, Floats]:
        """Displacement from rest and velocity of every atom at the start, both ``(n, 2)``."""
        ...

    def drive(self, velocity: Floats) -> None:
        """Give the boundary atoms their velocities for the window that begins.

        Parameters
        ----------
        velocity : ndarray, shape ``(len(needs), 2)``

        Raises
        ------
        BackendError
            An atom has left the nodes that this rank knows.
        """
        ...

    def fields(self, span: float) -> dict[str, Floats]:
        """Fields of the scheme on ``offers``; collective among neighbouring patches.

        Parameters
        ----------
        span : float
            Length of the window that ended now, since which ``d2_gimpmd_last`` holds the
            positions at its start; 0 at the start of the run.
        """
        ...

    def dissipated(self) -> float:
        """Energy that this rank's atoms have lost on purpose since the start (energy units)."""
        ...

"""What the service asks of an atomistic code; whoever offers this can take LAMMPS's place."""

from __future__ import annotations

from typing import Protocol

from gimpmd_schemas.arrays import Floats, Ints
from gimpmd_schemas.grid.zones import Box


class MdBackend(Protocol):
    """The atoms of one patch, standing at a coupling time.

    Attributes
    ----------
    name : str
        Code and version, as the registration tells it.
    patch : Box
        The part of the MD region that this rank holds.
    offers, needs : ndarray of int64
        Ids of the nodes whose fields this rank gives and wants.
    """

    name: str
    patch: Box
    offers: Ints
    needs: Ints

    def zone_fields(self) -> dict[str, Floats]:
        """Fields of the coupling scheme on ``offers``, see ``messages.SCHEME_FIELDS``.

        ``mass`` of shape ``(n,)`` and ``velocity`` of shape ``(n, 2)``, averaged over the window
        that ended now; or ``force`` of shape ``(n, 2)`` at its end.
        """
        ...

    def finish(self) -> None:
        """Bring the window to its end, or the set-up: all that the continuum does not wait for."""
        ...

    def energies(self) -> dict[str, float]:
        """Conserved quantities of this rank's atoms, see ``messages.Account``."""
        ...

    def timings(self) -> dict[str, float]:
        """Wall seconds by phase since the last call."""
        ...

    def advance(self, velocity: Floats) -> None:
        """Advance by one coupling step.

        Parameters
        ----------
        velocity : ndarray, shape ``(len(needs), 2)``
            Nodal velocities that the boundary atoms follow.
        """
        ...

    def close(self) -> None:
        """Release the code and its files."""
        ...

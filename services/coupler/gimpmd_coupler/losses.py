"""Which rank was lost first. Pure logic; times in seconds.

A connection may go down because a process died or because the network failed. Where the process
can be looked up, its state decides. When one rank dies, MPI kills the other ranks of its service a
few milliseconds later. So the first lost rank is the culprit, and the others are its victims. On a
busy machine the bus may tell of a victim first.
"""

from __future__ import annotations

from collections.abc import Callable

from gimpmd_schemas.wire.messages import Member

COLLECT_SECONDS = 0.06
"""Time in which a message sent before the connection went down is still read."""

_LOOK_SECONDS = 0.02


class Losses:
    """Ranks whose connection is down, in the order in which they were lost.

    Parameters
    ----------
    is_running : callable
        Whether the process of a rank still runs; True where this is unknown.
    reconnect : float
        Time within which a running process must connect again.
    """

    def __init__(self, is_running: Callable[[Member], bool], reconnect: float) -> None:
        self._is_running = is_running
        self._reconnect = reconnect
        self._since: dict[Member, float] = {}

    def down(self, member: Member, now: float) -> None:
        """Note that a connection went down."""
        self._since.setdefault(member, now)

    def up(self, member: Member) -> None:
        """Note that a connection is back."""
        self._since.pop(member, None)

    def next_due(self, now: float) -> float:
        """When to call ``culprit`` again; a process may die without a further event."""
        return now + _LOOK_SECONDS if self._since else float("inf")

    def first_dead(self) -> Member | None:
        """Return the first rank whose process is gone."""
        return next((member for member in self._since if not self._is_running(member)), None)

    def culprit(self, now: float) -> Member | None:
        """Return the first rank that is lost and cannot come back, or None."""
        for member, since in self._since.items():
            grace = self._reconnect if self._is_running(member) else COLLECT_SECONDS
            if now >= since + grace:
                return member
        return None

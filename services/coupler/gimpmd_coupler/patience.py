"""How long the coupler waits for silent ranks, in stages. Pure logic; times in seconds."""

from __future__ import annotations

from enum import Enum


class Stage(Enum):
    """What is due: multiples of the base deadline without any progress."""

    SAY = 1  # say whom we wait for
    DIAGNOSE = 3  # log what is known of them
    FAIL = 10  # end the run


class Patience:
    """Counts the time without progress.

    Parameters
    ----------
    base : float
        Deadline whose multiples are the stages.
    now : float
    """

    def __init__(self, base: float, now: float) -> None:
        self.restart(base, now)

    def restart(self, base: float, now: float) -> None:
        """Begin anew: there was progress."""
        self._base, self._since = base, now
        self._ahead = list(Stage)

    def waited(self, now: float) -> float:
        """Time without progress."""
        return now - self._since

    def next_due(self) -> float:
        """When the next stage falls due."""
        return self._since + self._base * self._ahead[0].value if self._ahead else float("inf")

    def due(self, now: float) -> Stage | None:
        """Return the stage that has fallen due, once."""
        return self._ahead.pop(0) if now >= self.next_due() else None

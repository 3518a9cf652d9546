"""How long the coupler waits for silent ranks, in stages. Pure logic; times in seconds."""

from __future__ import annotations

from enum import Enum


class Stage(Enum):
    """Stages of waiting, as multiples of the base deadline without progress."""

    SAY = 1  # report which ranks the coupler waits for
    DIAGNOSE = 3  # log what is known about them
    FAIL = 10  # end the run


class Patience:
    """Measures the time without progress.

    Parameters
    ----------
    base : float
        Base deadline.
    now : float
    """

    def __init__(self, base: float, now: float) -> None:
        self.restart(base, now)

    def restart(self, base: float, now: float) -> None:
        """Start again at zero: there was progress."""
        self._base, self._since = base, now
        self._ahead = list(Stage)

    def waited(self, now: float) -> float:
        """Time without progress."""
        return now - self._since

    def next_due(self) -> float:
        """Time of the next stage."""
        return self._since + self._base * self._ahead[0].value if self._ahead else float("inf")

    def due(self, now: float) -> Stage | None:
        """Return the stage that is due; each stage is returned once."""
        return self._ahead.pop(0) if now >= self.next_due() else None

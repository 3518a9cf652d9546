"""What a gate is, and the list of all of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np


@dataclass(frozen=True)
class Check:
    """A measured value and what it must be.

    Attributes
    ----------
    what : what was measured.
    measured : its value; not a number never passes.
    low, high : bounds that it must keep, both included.
    source : where the bounds come from.
    """

    what: str
    measured: float
    low: float = -np.inf
    high: float = np.inf
    source: str = ""

    @property
    def passed(self) -> bool:
        return bool(self.low <= self.measured <= self.high)

    @property
    def required(self) -> str:
        if np.isinf(self.low):
            return f"<= {self.high:.3g}"
        if np.isinf(self.high):
            return f">= {self.low:.3g}"
        return f"{self.low:.3g} .. {self.high:.3g}"


@dataclass(frozen=True)
class Gate:
    """A named measurement; ``long`` ones take more than a few seconds."""

    name: str
    long: bool
    measure: Callable[[], list[Check]]


GATES: list[Gate] = []


def gate(
    name: str, long: bool = False
) -> Callable[[Callable[[], list[Check]]], Callable[[], list[Check]]]:
    """Enter a function that returns checks in the list of gates."""

    def enter(measure: Callable[[], list[Check]]) -> Callable[[], list[Check]]:
        GATES.append(Gate(name, long, measure))
        return measure

    return enter


def rates(errors: list[float]) -> list[float]:
    """Orders of convergence of errors on meshes, each twice as fine as the one before."""
    return [float(np.log2(a / b)) for a, b in pairwise(errors)]

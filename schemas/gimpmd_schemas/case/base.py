"""What the parts of a case file have in common: strict structs, vectors, values over time."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from gimpmd_schemas.case.checks.rules import Rules
from gimpmd_schemas.grid.zones import Box

Pair = tuple[float, float]
PerAxis = Meta(min_length=2, max_length=3)
Vector = Annotated[tuple[float, ...], PerAxis]
"""A point or direction, one component for each axis."""
Region = Annotated[Box, PerAxis]
"""A box in the case file, one pair for each axis."""


class Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Base of all parts of the case file: immutable, and unknown keys are refused."""


class Timed(Strict, frozen=True):
    """A value that changes with time: by a ramp from zero, or by a piecewise linear history."""

    ramp: float = 0.0
    history: tuple[Pair, ...] = ()

    def factor(self, time: float) -> float:
        """Factor of the value at ``time``."""
        if self.history:
            times, factors = zip(*self.history, strict=True)
            return float(np.interp(time, times, factors))
        return 1.0 if self.ramp <= 0.0 else min(max(time / self.ramp, 0.0), 1.0)

    def mean_factor(self, start: float, end: float) -> float:
        """Mean of the factor from ``start`` to ``end``, which gives the exact impulse."""
        corners = [t for t, _ in self.history] if self.history else [0.0, self.ramp]
        times = [start, *(t for t in corners if start < t < end), end]
        return float(np.trapezoid([self.factor(t) for t in times], times) / (end - start))

    def integral(self, time: float) -> float:
        """Integral of the factor from the start to ``time``."""
        return self.mean_factor(0.0, time) * time if time > 0.0 else 0.0

    def check_time(self, key: str, rules: Rules) -> None:
        """Check the ramp and the history; only one of them may be given."""
        rules.require(self.ramp >= 0, f"{key}.ramp", self.ramp, "must not be negative")
        times = [time for time, _ in self.history]
        rules.require(
            all(a < b for a, b in pairwise(times)),
            f"{key}.history",
            times,
            "its times do not increase",
            "write [time, factor] pairs, each later than the one before",
        )
        rules.require(
            not (self.history and self.ramp > 0),
            f"{key}.ramp",
            self.ramp,
            "is given in addition to a history; only one time function is allowed",
            "remove one of the two",
        )

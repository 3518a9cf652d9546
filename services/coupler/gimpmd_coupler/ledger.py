"""The ledger of mass, momentum and energy over both sides."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gimpmd_schemas.wire.messages import Role

QUANTITIES = (
    "kinetic",
    "potential",
    "external_work",
    "interface_work",
    "dissipated",
    "mass",
    "momentum_x",
    "momentum_y",
)
"""What every rank reports at every step (``Exchange.energies``)."""


@dataclass(frozen=True)
class Entry:
    """The ledger at one step.

    Attributes
    ----------
    sides : sums over the ranks of each role, by quantity.
    energy : kinetic and potential energy of all sides.
    external_work : work done on all sides since the start.
    dissipated : energy that all sides have turned into heat on purpose (friction) since the start.
    balance : energy that went missing since the start, ``(W - D - (E - E0)) / max(|W|, |E0|)``:
        for a body that starts from rest the paper's ``(W - E) / W``; 0 while both are zero.
    """

    sides: dict[Role, dict[str, float]]
    energy: float
    external_work: float
    dissipated: float
    balance: float


class Ledger:
    """Adds up what ranks report; the first entry sets the energy at the start."""

    def __init__(self) -> None:
        self._start: float | None = None

    def enter(self, reports: Mapping[Role, Sequence[Mapping[str, float]]]) -> Entry:
        """Sum the reports of all ranks at one step.

        Parameters
        ----------
        reports : mapping of role to the ``energies`` of its ranks
            Quantities that a rank leaves out count as zero; a side none of whose ranks reports
            anything has no energies at this step (levels of the grid between their common times),
            and so the whole has none: they are NaN. The sums are exact to the last bit, so they
            depend on how a side is cut into patches only through the reports.
        """
        sides = {role: _sums(ranks) for role, ranks in reports.items()}
        energy = math.fsum(side["kinetic"] + side["potential"] for side in sides.values())
        work = math.fsum(side["external_work"] for side in sides.values())
        heat = math.fsum(side["dissipated"] for side in sides.values())
        if self._start is None:
            self._start = energy - work
        if math.isnan(energy):
            return Entry(sides, energy, work, heat, math.nan)
        scale = max(abs(work), abs(self._start))
        missing = work - heat - (energy - self._start)
        return Entry(sides, energy, work, heat, missing / scale if scale > 0.0 else 0.0)


def _sums(ranks: Sequence[Mapping[str, float]]) -> dict[str, float]:
    if not any(ranks):
        return dict.fromkeys(QUANTITIES, math.nan)
    return {q: math.fsum(rank.get(q, 0.0) for rank in ranks) for q in QUANTITIES}

"""The energy balance of the whole body."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from gimpmd_schemas.wire.energies import Energies


@dataclass(frozen=True)
class Total:
    """Energies of the whole body at one step (energy units).

    Attributes
    ----------
    energy : kinetic and potential energy E of all sides.
    external_work : work W done on all sides since the start.
    fix_work : work of the user's own fixes since the start.
    dissipated : energy D that all sides have turned into heat since the start.
    balance : missing energy, ``(W - D - (E - E0)) / max(|W|, |E0|)``, with E0 the energy at the
        start, and W the external work and the work of fixes together. For a body that starts at
        rest and has no dissipation this is ``(W - E) / W``, as in the paper. It is 0 while W and
        E0 are zero.
    """

    energy: float
    external_work: float
    fix_work: float
    dissipated: float
    balance: float


OPEN = Total(math.nan, math.nan, math.nan, math.nan, math.nan)
"""The total at a step without energies."""


class Ledger:
    """Computes the energy balance step by step.

    Parameters
    ----------
    start : float or None
        Energy at the start of the run, if the run goes on from a checkpoint. If not, the first step
        sets it.

    Attributes
    ----------
    start : float or None
        Energy at the start of the run, once it is known.
    """

    def __init__(self, start: float | None = None) -> None:
        self.start = start

    def add(self, sides: Iterable[Energies | None]) -> Total:
        """Compute the total at the next step.

        Parameters
        ----------
        sides : iterable of Energies or None
            The sums over the ranks of each side. A side has None at steps without energies: with
            several grid levels, at the times at which not all levels stand. Then the whole body
            has no energies either.

        Returns
        -------
        Total
            NaN in all components at a step without energies.
        """
        known: list[Energies] = []
        for side in sides:
            if side is None:
                return OPEN
            known.append(side)
        energy = math.fsum(side.kinetic + side.potential for side in known)
        external = math.fsum(side.external_work for side in known)
        fixes = math.fsum(side.fix_work for side in known)
        work = external + fixes
        heat = math.fsum(side.dissipated for side in known)
        if self.start is None:
            self.start = energy - work
        scale = max(abs(work), abs(self.start))
        missing = work - heat - (energy - self.start)
        return Total(energy, external, fixes, heat, missing / scale if scale > 0.0 else 0.0)

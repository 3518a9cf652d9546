"""Wall time and memory of the processes of a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np

from gimpmd_deploy.results.energies import ROLES
from gimpmd_deploy.results.frames import dataframe
from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.case.form import Role

WAIT = "wait"
"""Phase of the time that a process waits for others."""


@dataclass(frozen=True)
class Timings:
    """Wall time and memory of the processes of a run, over ``k`` coupling steps.

    Attributes
    ----------
    phases : dict by role of dicts by phase of ndarray, shape ``(k,)``
        Wall seconds of each step, mean over the ranks of the role; ``wait`` is time on the bus.
    busy : dict by ``role/rank``
        Wall seconds of a process in the whole run, without its waiting time.
    memory : dict by ``role/rank``
        Largest resident set of a process (bytes).
    """

    phases: Mapping[Role, Mapping[str, Floats]]
    busy: Mapping[str, float]
    memory: Mapping[str, int]

    @classmethod
    def read(cls, file: h5py.File) -> Timings:
        """Read ``timings`` and ``memory`` of ``run.h5``."""
        timings = file.get("timings", {})
        roles = [role for role in ROLES if role in timings]
        return cls(
            phases={role: _mean_over_ranks(timings[role]) for role in roles},
            busy={
                f"{role}/{rank}": _seconds(phases) - _seconds(phases, WAIT)
                for role in roles
                for rank, phases in timings[role].items()
            },
            memory={
                f"{role}/{rank}": int(data[:].max(initial=0))
                for role, ranks in file.get("memory", {}).items()
                for rank, data in ranks.items()
            },
        )

    def totals(self) -> dict[str, dict[str, float]]:
        """Return wall seconds of the whole run by role and phase."""
        return {
            role: {phase: float(seconds.sum()) for phase, seconds in phases.items()}
            for role, phases in self.phases.items()
        }

    def to_dataframe(self) -> Any:
        """Return a pandas DataFrame with a row for each step and columns like ``md_wait``.

        Raises
        ------
        BackendError
            pandas is not installed.
        """
        return dataframe(
            {
                f"{role}_{phase}": seconds
                for role, phases in self.phases.items()
                for phase, seconds in phases.items()
            }
        )


def _mean_over_ranks(ranks: h5py.Group) -> dict[str, Floats]:
    phases = dict.fromkeys(phase for rank in ranks.values() for phase in rank)
    return {
        phase: np.mean([rank[phase][:] for rank in ranks.values() if phase in rank], axis=0)
        for phase in phases
    }


def _seconds(phases: h5py.Group, *names: str) -> float:
    """Wall seconds of some phases, or of all."""
    chosen = [name for name in phases if not names or name in names]
    return float(sum(phases[name][:].sum() for name in chosen))

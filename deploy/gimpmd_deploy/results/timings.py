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
from gimpmd_schemas.wire.messages import Array

WAIT = "wait"
"""Phase of the time that a process waits for others."""


@dataclass(frozen=True)
class Timings:
    """Wall time and memory of the processes of a run, over ``k`` coupling steps.

    Attributes
    ----------
    phases : dict by role of dicts by phase of ndarray, shape ``(k,)``
        Wall seconds of each step, mean over the ranks of the role that took part in it; ``wait`` is
        time on the bus.
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
        found = file.get("timings", {})
        timings = {
            role: {phase: rows[:] for phase, rows in found[role].items()}
            for role in ROLES
            if role in found
        }
        peaks = {role: memory[:].max(axis=0) for role, memory in file.get("memory", {}).items()}
        return cls(
            phases={role: _means(phases) for role, phases in timings.items()},
            busy=_by_rank({role: _busy(phases) for role, phases in timings.items()}),
            memory=_by_rank(peaks),
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


def _means(phases: Mapping[str, Array]) -> dict[str, Floats]:
    """Mean of each phase over the ranks that took part in a step, shape ``(k,)``.

    After a resume there may be fewer ranks. Those that are gone have no time in any phase.
    """
    took_part = np.any([rows > 0.0 for rows in phases.values()], axis=0)
    ranks = np.maximum(took_part.sum(axis=1), 1)
    return {phase: rows.sum(axis=1, dtype=float) / ranks for phase, rows in phases.items()}


def _busy(phases: Mapping[str, Array]) -> Floats:
    """Wall seconds of each rank without its waiting time, shape ``(ranks,)``."""
    seconds = {phase: rows.sum(axis=0, dtype=float) for phase, rows in phases.items()}
    return np.asarray(sum(seconds.values()) - seconds.get(WAIT, 0.0))


def _by_rank(values: Mapping[str, Array]) -> dict[str, Any]:
    """Values of all processes by name, from those of the ranks of each role."""
    return {
        f"{role}/{rank}": value
        for role, of_role in values.items()
        for rank, value in enumerate(of_role.tolist())
    }

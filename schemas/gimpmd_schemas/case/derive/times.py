"""Time steps of both sides, and the steps at which the run ends, has energies and writes output."""

from __future__ import annotations

import math

from gimpmd_schemas.case.derive.levels import finest_cell
from gimpmd_schemas.case.derive.material import wave_speed
from gimpmd_schemas.case.form import Case

USUAL_CFL = 0.4
"""``c dt / h`` of an automatic time step. MUSL and USAVG become unstable at 1.66, and at 1.17 with
corrected dispersion."""

USUAL_ENERGIES = 200
"""Least number of times with energies if the case does not set their interval."""

MD_STEPS_BETWEEN_RENEWALS = 2000
"""Least number of MD steps between renewals of the state. One takes as long as about five steps."""

STEPS_BETWEEN_RENEWALS = 100
"""The same for coupling steps of a run without atoms."""


def md_timestep(case: Case) -> float:
    """Time step of the atoms.

    Raises
    ------
    ValueError
        The case has no atoms.
    """
    if case.time.md_timestep is None:
        raise ValueError("the case has no time step of atoms")
    return case.time.md_timestep


def md_steps(case: Case) -> int:
    """Temporal factor N (paper Eq. 17): the MD steps in one coupling step."""
    if case.time.md_steps != "auto":
        return case.time.md_steps
    wanted = 0.1 * finest_cell(case) / wave_speed(case, "bar")
    return max(1, round(wanted / md_timestep(case)))


def step(case: Case) -> float:
    """Time step of the finest level and of the coupling: ``N dt_MD``, or ``time.step``.

    Level k of K has the step ``step * 2**(K - k)``, which is the same CFL number on all levels.
    """
    if case.md is not None:
        return md_steps(case) * md_timestep(case)
    if case.time.step != "auto":
        return case.time.step
    return USUAL_CFL * finest_cell(case) / wave_speed(case, "P")


def steps_together(case: Case) -> int:
    """Coupling steps between two times at which all levels stand."""
    return 2 ** len(case.grid.levels)


def steps(case: Case) -> int:
    """Coupling steps from start to end. The last step reaches or passes the end time.

    At the end all levels stand at the same time, and there are energies.
    """
    every = energies_every(case)
    return every * math.ceil(steps_together(case) * _common_times(case) / every)


def steps_until(step: float, every: int, end: float) -> int:
    """Coupling steps to an end time, a multiple of the steps between energies.

    Parameters
    ----------
    step : float
        Length of a coupling step.
    every : int
        Coupling steps between energies.
    end : float
        End time.
    """
    return max(1, _whole(end / (every * step))) * every


def _whole(ratio: float) -> int:
    """The next whole number; a ratio may exceed one by round-off."""
    return round(ratio) if abs(ratio - round(ratio)) < 1e-9 else math.ceil(ratio)


def _common_times(case: Case) -> int:
    """Number of times until the end at which all levels stand."""
    return max(1, _whole(case.time.end / (steps_together(case) * step(case))))


def output_every(case: Case) -> int:
    """Coupling steps between outputs. All levels stand at the same time at an output.

    The last step is an output too, whether the interval meets it or not.
    """
    together = steps_together(case)
    return together * max(1, round(case.output.interval / (together * step(case))))


def energies_every(case: Case) -> int:
    """Coupling steps between energies. All levels stand at the same time at these steps.

    The interval is the longest one that is not longer than ``output.energy_interval`` and meets
    the end exactly. If none of more than half that length meets the end, the longest one is taken.
    """
    together, common = steps_together(case), _common_times(case)
    if case.output.energy_interval is None:
        wanted = common / USUAL_ENERGIES
    else:
        wanted = case.output.energy_interval / (together * step(case)) + 1e-9
    most = min(common, max(1, int(wanted)))
    usable = range(most, most // 2, -1)
    return together * next((count for count in usable if common % count == 0), most)


def renewal_every(case: Case) -> int:
    """Coupling steps between renewals of the state: those of the case, or many. See `Plan.renews`.

    Raises
    ------
    ValueError
        The case makes no checkpoints.
    """
    if case.checkpoint is None:
        raise ValueError("the case makes no checkpoints")
    together, wanted = steps_together(case), case.checkpoint.steps
    if wanted is None and (case.md is None or case.only == "continuum"):
        wanted = STEPS_BETWEEN_RENEWALS
    elif wanted is None:
        wanted = math.ceil(MD_STEPS_BETWEEN_RENEWALS / md_steps(case))
    return together * math.ceil(wanted / together)

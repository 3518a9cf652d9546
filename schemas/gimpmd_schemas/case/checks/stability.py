"""Time steps against the CFL condition and the fastest vibration of the lattice."""

from __future__ import annotations

from gimpmd_schemas.case.checks.numbers import MOST_STEPS
from gimpmd_schemas.case.checks.rules import Rules
from gimpmd_schemas.case.derive import choices
from gimpmd_schemas.case.derive.levels import finest_cell
from gimpmd_schemas.case.derive.material import wave_speed
from gimpmd_schemas.case.derive.times import USUAL_CFL, md_steps, md_timestep, step
from gimpmd_schemas.case.form import Case

MAX_CFL = 1.0
"""Largest accepted ``c dt / h``. USAVG and MUSL become unstable at 1.66 with four points to a cell
along each axis and later with fewer, and at 1.17 with corrected dispersion; 0.4 is usual."""

MAX_MD_FREQUENCY_STEP = 0.5
"""Largest accepted ``omega_max dt`` of the atoms; velocity Verlet is unstable beyond 2."""


def check_stability(case: Case, rules: Rules, spacing: float | None = None) -> None:
    """Time steps against the CFL condition and the fastest vibration of the lattice.

    Parameters
    ----------
    case : Case
        Its material must be known.
    rules : Rules
    spacing : float, optional
        Distance of neighbouring atoms, or ``sqrt(area per atom)``, which is 7 % less in a hexagonal
        crystal and so on the safe side. Without it the MD time step is not checked.
    """
    dt, h, c = step(case), finest_cell(case), wave_speed(case, "P")
    rules.require(
        case.time.end / dt <= MOST_STEPS,
        "time.end",
        case.time.end,
        f"would take {case.time.end / dt:.3g} coupling steps of {dt:g}; at most {MOST_STEPS:.0e}",
    )
    if case.only != "md":  # on every level, since steps and cells double together
        key, value, hint = _step_key(case, c)
        rules.require(
            c * dt / h <= MAX_CFL,
            key,
            value,
            f"makes the continuum step {dt:g} unstable: c dt / h = {c * dt / h:.3g} > {MAX_CFL:g}",
            hint,
        )
    absorber = choices.absorber(case) if choices.is_coupled_at_planes(case) else None
    if absorber is not None and absorber.rate is not None:
        rules.require(
            absorber.rate * dt <= 1.0,
            "coupling.absorber.rate",
            absorber.rate,
            f"takes more than all motion in a coupling step of {dt:g}",
            f"make it at most {1.0 / dt:.3g}",
        )
    if spacing is not None and case.only != "continuum":
        # hexagonal nearest neighbours: omega_max = sqrt(6 k / m) = 2.31 c_l / spacing
        frequency = 2.31 * c / spacing
        limit = MAX_MD_FREQUENCY_STEP / frequency
        rules.require(
            md_timestep(case) <= limit,
            "time.md_timestep",
            md_timestep(case),
            f"is too long for the lattice, whose fastest vibration is about {frequency:.4g}",
            f"at most {limit:.2g}",
        )


def _step_key(case: Case, c: float) -> tuple[str, float, str]:
    """Return the key that sets the step of the continuum, its value, and what would be stable."""
    h = finest_cell(case)
    if case.md is None:
        hint = (
            f"at most {MAX_CFL * h / c:.4g}; CFL {USUAL_CFL:g}, or auto, is {USUAL_CFL * h / c:.4g}"
        )
        return "time.step", step(case), hint
    dt = md_timestep(case)
    most, usual = (int(limit * h / c / dt) for limit in (MAX_CFL, USUAL_CFL))
    hint = (
        f"at most {most} steps of {dt:g}; CFL {USUAL_CFL:g} is {usual}"
        if most
        else f"no number of steps of {dt:g} is stable; enlarge grid.cell"
    )
    return "time.md_steps", md_steps(case), hint

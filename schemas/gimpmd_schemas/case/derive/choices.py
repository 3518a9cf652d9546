"""What ``auto`` and ``null`` mean for the coupling and for the scheme of the continuum."""

from __future__ import annotations

from typing import Literal

import msgspec

from gimpmd_schemas.case.derive.levels import finest_cell
from gimpmd_schemas.case.derive.material import wave_speed
from gimpmd_schemas.case.form import AT_PLANES, Absorber, Case

ABSORBER_CELLS = 4.0
"""Default width of the absorber, in cells of the finest level."""


def is_coupled_at_planes(case: Case) -> bool:
    """Whether both sides take part and are coupled at planes."""
    return case.only is None and case.coupling.scheme in AT_PLANES


def configuration(case: Case) -> Literal["current", "reference"]:
    """Where points stand on the background grid."""
    if case.continuum.configuration != "auto":
        return case.continuum.configuration
    coupled = case.only is None and case.coupling.scheme != "paper"
    return "reference" if coupled else "current"


def dispersion(case: Case) -> Literal["lumped", "corrected"]:
    """Whether the dispersion of waves on the grid is corrected."""
    if case.continuum.dispersion != "auto":
        return case.continuum.dispersion
    return "corrected" if is_coupled_at_planes(case) else "lumped"


def integrator(case: Case) -> Literal["usavg", "musl", "usf", "usl"]:
    """When the stress of the points is updated."""
    if case.continuum.integrator != "auto":
        return case.continuum.integrator
    return "musl" if case.only is None or dispersion(case) == "corrected" else "usavg"


def xpic_every(case: Case) -> int:
    """Steps between two uses of the XPIC filter; 0: never."""
    every = case.continuum.xpic.every
    if every != "auto":
        return every
    return 0 if configuration(case) == "reference" else 20


def filter_rate(case: Case) -> float:
    """Strength of the zone filter (1 / time). The scheme ``paper`` has no filter."""
    if case.coupling.scheme == "paper":
        return 0.0
    if case.coupling.filter_rate is not None:
        return case.coupling.filter_rate
    return 0.5 * wave_speed(case, "P") / finest_cell(case)


def absorber(case: Case) -> Absorber | None:
    """Absorber of short waves with its width, or None."""
    chosen = case.coupling.absorber
    if chosen is None or chosen.width is not None:
        return chosen
    return msgspec.structs.replace(chosen, width=ABSORBER_CELLS * finest_cell(case))

"""What ``auto`` and ``null`` mean for the coupling and for the scheme of the continuum."""

from __future__ import annotations

from typing import Literal

import msgspec

from gimpmd_schemas.case.derive.levels import finest_cell
from gimpmd_schemas.case.derive.material import slowest_speed, wave_speed
from gimpmd_schemas.case.derive.zones import zones
from gimpmd_schemas.case.form import AT_PLANES, Absorber, Case

ABSORBER_CELLS = 4.5
"""Default width of the absorber, in cells of the finest level."""

ABSORBER_RATE = 1.55
"""Default rate of the absorber, times the finest cell over the speed of shear waves.

With a width of 4 cells, 1.7 is needed for the same R of short waves, and T of S waves of 8 cells
falls by .0053 in place of .0049.
"""


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
    """Absorber of short waves with its rate and width, or None."""
    chosen, h = case.coupling.absorber, finest_cell(case)
    if chosen is None:
        return None
    rate, width = chosen.rate, chosen.width
    return msgspec.structs.replace(
        chosen,
        rate=ABSORBER_RATE * _shear_speed(case) / h if rate is None else rate,
        width=ABSORBER_CELLS * h if width is None else width,
    )


def _shear_speed(case: Case) -> float:
    """Speed of the slowest wave along the normal of the planes; of several, the fastest such."""
    normals = {
        axis
        for region in zones(case).regions
        for axis, sides in enumerate(region.interfaces)
        if any(sides)
    }
    return max(slowest_speed(case, axis) for axis in normals)

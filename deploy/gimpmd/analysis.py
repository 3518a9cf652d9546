"""What a run shows: crack tip and energy release, slip pulses and Mach lines, stress of atoms.

``docs/analysis.md`` shows how to use it.
"""

from gimpmd_deploy.analysis.crack import (
    Crack,
    CrackGrowth,
    CrackTip,
    crack_growth,
    crack_of,
    crack_tip,
)
from gimpmd_deploy.analysis.energy_release import EnergyReleaseRate, energy_release_rate
from gimpmd_deploy.analysis.j_integral import JIntegral, j_integral
from gimpmd_deploy.analysis.mach import MachAngle, mach_angle
from gimpmd_deploy.analysis.plane import Plane
from gimpmd_deploy.analysis.resistance import crack_resistance
from gimpmd_deploy.analysis.slip import (
    Patch,
    PulseSpeed,
    RowProfile,
    SlipEvents,
    SlipHistory,
    StickSlip,
    pulse_speed,
    row_profile,
    sliding_patches,
    slip_events,
    slip_history,
    stick_slip,
)
from gimpmd_deploy.analysis.stress import MaximumStress, atomic_stress, maximum_stress

__all__ = [
    "Crack",
    "CrackGrowth",
    "CrackTip",
    "EnergyReleaseRate",
    "JIntegral",
    "MachAngle",
    "MaximumStress",
    "Patch",
    "Plane",
    "PulseSpeed",
    "RowProfile",
    "SlipEvents",
    "SlipHistory",
    "StickSlip",
    "atomic_stress",
    "crack_growth",
    "crack_of",
    "crack_resistance",
    "crack_tip",
    "energy_release_rate",
    "j_integral",
    "mach_angle",
    "maximum_stress",
    "pulse_speed",
    "row_profile",
    "sliding_patches",
    "slip_events",
    "slip_history",
    "stick_slip",
]

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
from gimpmd_deploy.analysis.plane import Plane

__all__ = [
    "Crack",
    "CrackGrowth",
    "CrackTip",
    "Plane",
    "crack_growth",
    "crack_of",
    "crack_tip",
]

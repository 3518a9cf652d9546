"""The gates of a scheme, in the order of docs/verification.md."""

from __future__ import annotations

from functools import partial

from tests.physics.gimp.gates import Gate
from tests.physics.interface import absorbers, crack, expansion, noise, packets, stress
from tests.physics.interface.schemes import SchemeName

SHORT = {
    "packets, 12 h": packets.short_packets,
}
"""Part of `make test` for the default scheme."""

DEFAULT: SchemeName = "force"

LONG = {
    "broadband, T = 0, short": noise.short_broadband,
    "packets, both ways, P and S": packets.long_packets,
    "oblique packets": packets.oblique,
    "temporal factor": packets.temporal_factor,
    "one rank and two": packets.ranks,
    "levels beside the interface": packets.levels,
    "broadband, T = 0": noise.long_broadband,
    "broadband, levels and ranks": noise.broadband_layouts,
    "heat, T = 0.05": partial(noise.thermal, temperature=0.05, end=500.0),
    "heat, T = 0.01": partial(noise.thermal, temperature=0.01, end=500.0),
    "held strain": noise.held,
    "held strain, levels and ranks": noise.held_layouts,
    "stress test": stress.stress,
    "quarter-scale crack": crack.crack,
}

FORCE = {
    "growing crack, quarter scale": crack.growing,
    "thermal expansion": expansion.expansion,
    "absorber, resolved packets": absorbers.resolved_waves,
    "absorber, short waves": absorbers.short_waves,
    "absorber, T = 0.05": absorbers.heat,
}
"""Long ones of the force scheme alone."""


def gates_of(scheme: SchemeName) -> list[Gate]:
    """All gates of a scheme."""
    return [
        Gate(f"{scheme}: {name}", long, partial(measure, scheme))
        for long, gates in (
            (scheme != DEFAULT, SHORT),
            (True, LONG),
            (True, FORCE if scheme == "force" else {}),
        )
        for name, measure in gates.items()
    ]

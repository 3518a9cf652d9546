"""Made-up disasters: small runs whose results are garbage, and what the monitors must say."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from gimpmd_schemas.wire.findings import Kind, Side
from tests.cases import EXAMPLE, REMOVE, changed, small_case
from tests.monitors.running import Story

WHOLE = {"md.variables": {"crack_length": 0.01, "crack_plane": 32}}
"""The small case without its crack."""

UNLOADED: dict[str, Any] = WHOLE | {"boundary": {}}

AFTER: dict[str, Any] = {"md.after": "after.in"}


@dataclass(frozen=True)
class Disaster:
    """A disaster.

    Attributes
    ----------
    about : what is wrong.
    story : the run.
    side, kind : a finding that must be made.
    """

    about: str
    story: Story
    side: Side
    kind: Kind


def small(changes: dict[str, Any], after: str = "", **scripts: str) -> Story:
    """The small case with changes, the text of ``md.after``, and other scripts."""
    if after:
        changes = changes | AFTER
        scripts = scripts | {"after.in": after}
    one = {"md.ranks": 1, "md.patches": "auto"}
    case = changed(small_case(), one | changes)
    case["output"]["interval"] = case["time"]["end"]
    return Story(case, scripts)


def dislocations() -> str:
    """``md.after``: two dislocations that slip the rows between them, as displacements.

    Hirth and Lothe, Theory of Dislocations, eq. 3-45, Poisson's ratio 1/4; the slip plane lies
    midway between two rows of the crystal, where ``crack.in`` puts its crack.
    """
    lines = ["variable b equal 1.1132013035564605"]
    along, up = [], []
    for name, core, sign in (("l", 14.0, "-"), ("r", 20.0, "+")):
        lines += [
            f"variable x{name} atom x-{core}",
            f"variable y{name} atom y-32.0",
            f"variable s{name} atom v_x{name}*v_x{name}+v_y{name}*v_y{name}",
            # the arctangent from -pi to pi
            f"variable a{name} atom 2.0*atan(v_y{name}/(sqrt(v_s{name})+v_x{name}))",
            f"variable u{name} atom v_b/6.2831853*(v_a{name}+v_x{name}*v_y{name}/(1.5*v_s{name}))",
            f"variable w{name} atom -v_b/6.2831853*(ln(v_s{name})/6.0"
            f"+(v_x{name}*v_x{name}-v_y{name}*v_y{name})/(3.0*v_s{name}))",
        ]
        along.append(f"{sign}v_u{name}")
        up.append(f"{sign}v_w{name}")
    lines += [
        f"variable u atom {''.join(along)}",
        f"variable w atom {''.join(up)}",
        "displace_atoms gimpmd_free move v_u v_w 0.0 units box",
    ]
    return "\n".join(lines) + "\n"


FIX_IN_INPUT = "fix pump all viscous -0.5\n"

BATH_IN_INPUT = "fix bath all langevin 0.02 0.02 1.0 12345\n"

EXCHANGED: dict[str, Any] = {"coupling": {"scheme": "velocity", "zones": {"outer": 2.5}}}

WAVE = {"packets": [{"center": 32.0, "wavelength": 24.0, "strain": 2e-3, "cycles": 1.0}]}


def crack_script(text: str) -> dict[str, str]:
    """The example's script with more lines."""
    return {"crack.in": (EXAMPLE / "crack.in").read_text() + text}


DISASTERS: dict[str, Callable[[], Disaster]] = {
    "crack": lambda: Disaster(
        "a crack runs through a plane",
        small(
            {"time.end": 20.0, "boundary.top.value": [0, 4.0], "boundary.bottom.value": [0, -4.0]}
        ),
        "md",
        "broken bond",
    ),
    "dislocation": lambda: Disaster(
        "a dislocation glides into a plane",
        small(
            UNLOADED
            | {
                "time.end": 10.0,
                "initial": {"stretch": {"gradient": [[0.0, 0.06], [0.0, 0.0]], "center": [16, 32]}},
            },
            dislocations(),
        ),
        "md",
        "broken bond",
    ),
    "deleted": lambda: Disaster(
        "one atom in a hundred is deleted",
        small(UNLOADED, "delete_atoms random fraction 0.01 yes gimpmd_free NULL 12345\n"),
        "md",
        "atoms",
    ),
    "evaporated": lambda: Disaster(
        "atoms evaporate during the run",
        small(
            UNLOADED,
            "region all block INF INF INF INF INF INF\n"
            "fix gone gimpmd_free evaporate 200 1 all 12345\n",
        ),
        "md",
        "mass",
    ),
    "stronger after": lambda: Disaster(
        "the potential is four times as strong from the start of the run on",
        small(WHOLE, "pair_coeff * * 4 1\n"),
        "md",
        "initial energy",
    ),
    "stronger": lambda: Disaster(
        "the potential of the atoms is four times as strong as that of the continuum",
        small(WHOLE, **crack_script("pair_coeff * * 4 1\npair_modify shift yes\n")),
        "continuum",
        "stiffness",
    ),
    "hot": lambda: Disaster(
        "a thermostat at T = 50",
        small(
            UNLOADED | {"time.md_timestep": 0.0005},
            "fix hot gimpmd_free langevin 50 50 0.5 12345\n",
        ),
        "md",
        "speed",
    ),
    "pulled": lambda: Disaster(
        "a linear law is strained by 0.27",
        small(
            {
                "only": "continuum",
                "md": REMOVE,
                "time": {"end": 10.0},
                "boundary.top.value": [0, 10.0],
                "boundary.bottom.value": [0, -10.0],
                "continuum.cracks": [],
                "continuum.configuration": "reference",
            }
        ),
        "continuum",
        "strain",
    ),
    "short waves": lambda: Disaster(
        "a wave of two cells comes to the planes",
        small(
            UNLOADED
            | {
                "time.end": 4.0,
                "initial": {
                    "packets": [{"center": 15.0, "wavelength": 4.0, "strain": 5e-3, "cycles": 1.0}]
                },
            }
        ),
        "md",
        "short waves",
    ),
    "pumped": lambda: Disaster(
        "a fix of md.input, whose work is not measured, feeds energy to the atoms",
        small(UNLOADED | {"time.end": 8.0}, **crack_script(FIX_IN_INPUT)),
        "md",
        "energy",
    ),
    "pumped exchange": lambda: Disaster(
        "the same in the velocity scheme, under load",
        small(WHOLE | EXCHANGED | {"time.end": 8.0}, **crack_script(FIX_IN_INPUT)),
        "body",
        "total energy",
    ),
    "bath of the exchange": lambda: Disaster(
        "a thermostat of md.input, whose work is not measured, in the velocity scheme",
        small(
            UNLOADED | EXCHANGED | {"time.end": 4.0, "initial": WAVE},
            **crack_script(BATH_IN_INPUT),
        ),
        "body",
        "total energy",
    ),
}
"""Disasters by name. A function makes each, so that a test makes only its own."""

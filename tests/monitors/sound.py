"""Sound runs at random: small bodies with loads, waves and heat, with or without a crack."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.cases import REMOVE, changed, small_case
from tests.monitors.running import Story

MELTING = 0.4
"""Temperature at which the crystal melts."""

CAUCHY_BORN = {"from": "md", "model": "cauchy-born", "cell": "bulk.in"}


def sound(seed: int, scheme: str | None = None) -> Story:
    """A sound run, always the same for a seed.

    With a scheme, all runs with atoms have it, in place of one at random.

    Strains stay below 2 % and temperatures below a tenth of the melting temperature. Waves are 8
    cells long or longer; a crack is too short to grow.
    """
    random = np.random.default_rng(seed)
    steps = int(random.integers(5, 40))
    changes: dict[str, Any] = {
        "name": f"sound-{seed}",
        "time": {
            "end": float(random.uniform(2.0, 6.0)),
            "md_timestep": float(random.uniform(0.001, min(0.005, 0.08 / steps))),
            "md_steps": steps,
        },
        "md.ranks": 1,
        "md.patches": "auto",
        "md.variables": {
            "crack_length": float(random.choice([0.01, 6.0, 12.0])),
            "crack_plane": 32,
        },
        "coupling": {"scheme": str(random.choice(["force", "force", "velocity"]))},
        "boundary": _boundary(random),
        "initial": {},
    }
    held = any(face["condition"] == "velocity" for face in changes["boundary"].values())
    changes["initial"] = _initial(random, held)
    if changes["coupling"]["scheme"] == "velocity":
        changes["coupling"]["zones"] = {"outer": 2.5}
    if random.random() < 0.5:
        changes["continuum.material"] = CAUCHY_BORN
    elif random.random() < 0.5:
        changes["continuum.material.model"] = "neo-hookean"
    if changes["coupling"]["scheme"] == "force" and random.random() < 0.25:
        changes["coupling"]["absorber"] = {"rate": 1.0}
    if scheme is not None:
        changes["coupling"] = {"scheme": scheme}
        if scheme in ("velocity", "paper"):
            changes["coupling"]["zones"] = {"outer": 2.5}
    scripts = {}
    # next to a held face of the atoms, heat breaks bonds: the monitors are right to say so
    if random.random() < 0.4 and not (held and "left" in changes["boundary"]):
        changes["md.after"] = "after.in"
        scripts["after.in"] = _heat(random)
    if random.random() < 0.15:
        changes |= {"only": "continuum", "md": REMOVE, "time": {"end": changes["time"]["end"]}}
        changes["continuum.material"] = {
            "from": "moduli", "density": 0.93, "lame": 28.0, "shear": 28.0
        }  # fmt: skip
        changes = {k: v for k, v in changes.items() if not k.startswith(("md.", "coupling"))}
        scripts = {}
    case = changed(small_case(), changes)
    case["output"]["interval"] = case["time"]["end"]
    return Story(case, scripts)


def _boundary(random: np.random.Generator) -> dict[str, Any]:
    """Tractions or motion of two opposite faces."""
    kind = random.choice(["free", "traction", "velocity"])
    if kind == "free":
        return {}
    size = 0.4 if kind == "traction" else 0.05
    value = random.uniform(-size, size, 2).tolist()
    ends = random.choice(["top bottom", "right left"]).split()
    ramp = {"ramp": float(random.uniform(0.5, 3.0))}
    return {
        face: {"condition": str(kind), "value": [sign * v for v in value]} | ramp
        for face, sign in zip(ends, (1, -1), strict=True)
    }


def _initial(random: np.random.Generator, held: bool) -> dict[str, Any]:
    """At rest, stretched, with a wave or, where no face is held, in flight or turning."""
    kinds = ["rest", "stretch", "packet"]
    kind = random.choice(kinds if held else [*kinds, "flight", "turn"])
    if kind == "stretch":
        return {"stretch": {"gradient": random.uniform(-0.006, 0.006, (2, 2)).tolist()}}
    if kind == "packet":
        packet = {
            "center": float(random.uniform(10.0, 50.0)),
            "wavelength": float(random.uniform(16.0, 40.0)),
            "strain": float(random.uniform(1e-4, 5e-3)),
            "cycles": 1.0,
            "axis": int(random.integers(0, 2)),
            "direction": int(random.choice([-1, 1])),
            "polarization": str(random.choice(["P", "S"])),
        }
        return {"packets": [packet]}
    if kind == "flight":
        return {"velocities": [{"velocity": random.uniform(-0.3, 0.3, 2).tolist()}]}
    if kind == "turn":
        rate = float(random.uniform(-0.01, 0.01))
        field = {"velocity": [0, 0], "gradient": [[0, -rate], [rate, 0]], "center": [32, 32]}
        return {"velocities": [field]}
    return {}


def _heat(random: np.random.Generator) -> str:
    """``md.after``: free atoms that move at random from the start, or a thermostat."""
    temperature = random.uniform(0.0, 0.1 * MELTING)
    if random.random() < 0.5:
        # half of the kinetic energy becomes potential energy
        return f"velocity gimpmd_free create {2.0 * temperature} 4928459 dist gaussian mom yes\n"
    return f"fix bath gimpmd_free langevin {temperature} {temperature} 1.0 12345\n"

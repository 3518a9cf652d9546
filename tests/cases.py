"""Small cases that tests share, as plain values, and how to change them.

``CASE`` with ``ATOMS`` is a block of atoms beside a block of continuum, coupled by the velocity
scheme. `small_case` is the example with a crack, shrunk to about 1,000 atoms and coupled by the
force scheme. ``BAR`` is a periodic bar of continuum with density and wave speed 1.
"""

from __future__ import annotations

import copy
import math
from pathlib import Path
from typing import Any

import yaml

EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "mode1-small"

ATOMS = """\
variable xlo index 0
variable xhi index 60
variable ylo index 0
variable yhi index 80
units lj
dimension 2
boundary s s p
atom_style atomic
variable a equal 1.1132013035564605
variable density equal 2/(sqrt(3)*v_a^2)
lattice hex ${density} origin 0.25 0.25 0
region box block ${xlo} ${xhi} ${ylo} ${yhi} -0.5 0.5 units box
create_box 1 box
create_atoms 1 region box
mass 1 1
pair_style lj/cut 2.5
pair_coeff 1 1 1 1
"""

CASE: dict[str, Any] = {
    "gimpmd": 1,
    "name": "block",
    "units": "lj",
    "domain": {"box": [[0, 120], [0, 80]]},
    "grid": {"cell": 4, "points_per_axis": 2},
    "time": {"end": 0.8, "md_timestep": 0.002, "md_steps": 40},
    "md": {"region": [[0, 60], [0, 80]], "input": "atoms.in"},
    "coupling": {"scheme": "velocity"},
    "continuum": {
        "material": {"from": "moduli", "density": 0.9318, "lame": 27.83, "shear": 27.83},
        "threads": 1,
    },
    "boundary": {"right": {"condition": "traction", "value": [0.1, 0], "ramp": 0.2}},
    "output": {"interval": 0.4},
}

BAR: dict[str, Any] = {
    "gimpmd": 1,
    "name": "bar",
    "units": "lj",
    "domain": {"box": [[0.0, 32.0], [0.0, 2.0]], "periodic": [True, True]},
    "grid": {"cell": 1.0},
    "time": {"end": 1.0, "md_timestep": 0.4, "md_steps": 1},
    "md": {"region": [[0.0, 32.0], [0.0, 2.0]], "input": "none.in"},
    "coupling": {"scheme": "velocity"},
    "continuum": {
        "material": {"from": "moduli", "density": 1.0, "lame": 1.0 / 3.0, "shear": 1.0 / 3.0},
        "xpic": {"every": 0},
    },
    "output": {"interval": 1.0},
    "only": "continuum",
}

REMOVE = object()
"""Stands for a key that is to be left out."""

CONTINUUM_ONLY: dict[str, Any] = {"only": "continuum", "md": REMOVE, "time": {"end": 1}}
"""Changes that make a case one of the continuum only."""

BLOCK_3D: dict[str, Any] = CONTINUUM_ONLY | {
    "domain.box": [[0, 40], [0, 32], [0, 24]],
    "boundary": {},
}
"""Changes that make a case one of a block in three dimensions."""


def changed(case: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Return a copy of a case with values replaced by dotted key."""
    case = copy.deepcopy(case)
    for key, value in changes.items():
        *parents, last = key.split(".")
        part = case
        for parent in parents:
            part = part.setdefault(parent, {})
        if value is REMOVE:
            del part[last]
        else:
            part[last] = copy.deepcopy(value)
    return case


def small_case() -> dict[str, Any]:
    """Return the example's case, shrunk to a domain of 64 x 64 with cells of 2."""
    case = yaml.safe_load((EXAMPLE / "case.yaml").read_text())
    case["name"] = "small"
    case["domain"]["box"] = [[0, 64], [0, 64]]
    case["grid"]["cell"] = 2
    case["time"] = {"end": 2.0, "md_timestep": 0.002, "md_steps": 20}
    case["md"]["region"] = [[0, 33], [14.5, 49.5]]
    case["md"]["variables"] = {"crack_length": 12, "crack_plane": 32}
    case["continuum"]["cracks"] = [{"from": [0, 32], "to": [12, 32]}]
    case["continuum"]["material"] = {
        "from": "moduli",
        "density": 0.9317984,
        "lame": 27.83316,
        "shear": 27.83316,
    }
    case["output"]["interval"] = 1.0
    for face in ("top", "bottom"):
        case["boundary"][face]["ramp"] = 1
    return case


def on_patches(
    case: dict[str, Any], md: list[int], gimp: list[int] | None = None
) -> dict[str, Any]:
    """A copy of a case on so many patches along each axis; the continuum may stay as it is."""
    changed_case = copy.deepcopy(case)
    for side, patches in (("md", md), ("continuum", gimp)):
        if patches is not None:
            changed_case[side] |= {"ranks": math.prod(patches), "patches": patches}
    return changed_case

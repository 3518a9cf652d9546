"""A small block of atoms in a continuum, as a case."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import msgspec
import numpy as np

from gimpmd_schemas.case.form import Case
from gimpmd_schemas.mechanics.units import UNITS

BLOCK: dict[str, Any] = {
    "gimpmd": 1,
    "name": "block",
    "units": "lj",
    "domain": {"box": [[0, 52], [0, 52]]},
    "grid": {"cell": 2.6},
    "time": {"end": 8, "md_timestep": 0.002, "md_steps": 20},
    "md": {"region": [[13, 39], [13, 39]], "input": "block.in"},
    "coupling": {"scheme": "velocity"},
    "continuum": {
        "material": {"from": "moduli", "density": 0.9317984, "lame": 27.8332, "shear": 27.8332},
    },
    "output": {"interval": 1000},
}
"""Atoms 26 by 26 in the middle of a continuum; interfaces all around."""

ALONE: dict[str, Any] = {
    "only": "md",
    "domain__box": [[0, 26], [0, 26]],
    "md__region": [[0, 26], [0, 26]],
}
"""The block without a continuum, free all around."""

A = 1.1132013035564605
ROW = A * 3**0.5 / 2
"""Spacing of atoms along x, and of rows."""

FORCE: dict[str, Any] = {
    "coupling__scheme": "force",
    "coupling__planes": {
        "left": 28 * A / 2,
        "right": 65 * A / 2,
        "bottom": 17 * ROW,
        "top": 37 * ROW,
    },
    "coupling__crystal": {
        "vectors": [[A, 0.0], [A / 2, ROW]],
        "origin": [0.25 * A, 0.5 * ROW],
        "bonds": [[A, 0.0], [A / 2, ROW], [-A / 2, ROW]],
        "energy": [[1.0], [1.0], [1.0]],
        "stretch_limit": 0.1,
    },
}
"""The block with the force scheme; its planes lie midway between layers of atoms.

What the continuum needs of the crystal, bonds and their energy, means nothing to the atoms.
"""

WIDTH = 12 * A * 3**0.5

TURNS: dict[str, Any] = {"time": {"end": 40, "md_timestep": 0.005, "md_steps": 20}}

RATE, CENTER = 0.1, 26.0
"""Angular velocity of the spinning block, and both coordinates of its middle."""

SPINNING: dict[str, Any] = {**TURNS, "grid__cell": 1.3}
"""Cells so small that the halo of a patch does not reach across the block."""

SLIDING: dict[str, Any] = {
    **TURNS,
    "domain": {"box": [[0, 3 * WIDTH], [0, 2 * WIDTH]], "periodic": [False, True]},
    "grid__cell": WIDTH / 16,
    "md__region": [[WIDTH, 2 * WIDTH], [0, 2 * WIDTH]],
    "md__variables": {"edge": "p", "gap": 0.7},
    "coupling__planes": {"left": 48 * A / 2, "right": 78 * A / 2},
}
"""A strip, periodic along y; without the atoms around its middle its halves can slide."""


def block_case(**changes: Any) -> Case:
    """The block with ``section__key=value`` set."""
    raw = deepcopy(BLOCK)
    for path, value in changes.items():
        *parents, last = path.split("__")
        place = raw
        for parent in parents:
            place = place.setdefault(parent, {})
        place[last] = value
    return msgspec.convert(raw, Case)


SIGMA, EPSILON, MASS = 3.405, 0.0104, 39.948
"""Argon, in metal units."""

TAU = SIGMA * float(np.sqrt(MASS * UNITS["metal"].mvv2e / EPSILON))
"""Unit of time of argon, in metal units."""


def argon() -> dict[str, Any]:
    """Changes that make the block the same crystal in argon's units."""
    pressure = EPSILON / SIGMA**2 * UNITS["metal"].nktv2p
    return {
        "units": "metal",
        "domain__box": [[0, 52 * SIGMA]] * 2,
        "grid__cell": 2.6 * SIGMA,
        "time": {"end": 8 * TAU, "md_timestep": 0.002 * TAU, "md_steps": 20},
        "md__region": [[13 * SIGMA, 39 * SIGMA]] * 2,
        "md__variables": {"scale": SIGMA, "style": "metal", "mass": MASS, "epsilon": EPSILON},
        "continuum__material": {
            "from": "moduli",
            "density": 0.9317984 * MASS / SIGMA**2,
            "lame": 27.8332 * pressure,
            "shear": 27.8332 * pressure,
        },
        "output__interval": 1000 * TAU,
    }

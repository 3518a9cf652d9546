"""A box of copper in three dimensions, in a run of MD only."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import msgspec

from gimpmd_schemas.case.form import Case
from tests.cases import changed

A = 3.615
"""Lattice constant (angstrom)."""

SIZE = (8 * A, 6 * A, 4 * A)
"""Edges of the box (angstrom)."""

BOX: dict[str, Any] = {
    "gimpmd": 1,
    "name": "copper",
    "units": "metal",
    "only": "md",
    "domain": {"box": [[0, edge] for edge in SIZE]},
    "grid": {"cell": 2 * A},
    "time": {"end": 1.0, "md_timestep": 0.002, "md_steps": 10},
    "md": {"region": [[0, edge] for edge in SIZE], "input": "copper.in"},
    "continuum": {
        "material": {
            "from": "stiffness",
            "density": 4 * 63.55 / A**3,
            "stiffness": [
                [1.67e6, 1.24e6, 1.24e6, 0, 0, 0],
                [1.24e6, 1.67e6, 1.24e6, 0, 0, 0],
                [1.24e6, 1.24e6, 1.67e6, 0, 0, 0],
                [0, 0, 0, 7.6e5, 0, 0],
                [0, 0, 0, 0, 7.6e5, 0],
                [0, 0, 0, 0, 0, 7.6e5],
            ],
        },
    },
    "output": {"interval": 1000},
}

PERIODIC: dict[str, Any] = {
    "domain.periodic": [True, True, True],
    "md.variables": {"edge_x": "p", "edge_y": "p", "edge_z": "p"},
}
"""Changes that make it periodic along all axes."""

LOADS: dict[str, Any] = {
    "boundary": {
        "right": {"condition": "traction", "value": [5000, 0, 0], "ramp": 0.1},
        "left": {"condition": "symmetry"},
        "front": {"condition": "velocity", "value": [None, None, 0.2]},
        "back": {"condition": "symmetry"},
    }
}
"""Changes that load some of its faces."""


def copper_case(changes: dict[str, Any] | None = None) -> Case:
    """The box with values replaced by dotted key."""
    return msgspec.convert(changed(deepcopy(BOX), changes or {}), Case)

"""Drag on the atoms near the energy plane, in the velocity scheme (docs/monitors.md)."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cases import changed, small_case
from tests.monitors.running import Story, gain

RATE = 0.01

TURNING = {
    "time": {"end": 7.6, "md_timestep": 0.002, "md_steps": 20},
    "md.ranks": 1,
    "md.patches": "auto",
    "md.variables": {"crack_length": 0.01, "crack_plane": 32},
    "md.after": "after.in",
    "coupling": {"scheme": "velocity", "zones": {"outer": 2.5}},
    "boundary": {},
    "initial": {
        "velocities": [
            {"velocity": [0, 0], "gradient": [[0, -RATE], [RATE, 0]], "center": [32, 32]}
        ]
    },
}

DRAG = "fix drag {group} viscous 1.0\n"

DEEPER = "region deep block -1 28.5 19 45 INF INF units box\ngroup deep region deep\n"
"""The energy plane is 2.5 inside the region of the atoms, [0, 33] x [14.5, 49.5]; a cell is 2."""


@pytest.mark.long
@pytest.mark.parametrize(
    ("script", "low", "high"),
    [
        pytest.param(DRAG.format(group="gimpmd_free"), 0.03, 0.08, id="up to the plane"),
        pytest.param(DEEPER + DRAG.format(group="deep"), -0.03, 0.0, id="a cell deeper"),
    ],
)
def test_the_body_gains_where_the_continuum_misses_the_drag(
    tmp_path: Path, script: str, low: float, high: float
) -> None:
    """A turning body with drag on its atoms; a loss is no finding, the scheme takes energy out."""
    story = Story(changed(small_case(), TURNING), {"after.in": script})
    assert low < gain(story, tmp_path) < high

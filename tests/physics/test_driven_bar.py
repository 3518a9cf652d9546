"""A driven bar is the same body coupled, as atoms alone, and as continuum alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

import gimpmd
from gimpmd_schemas.case.form import Case
from tests.cases import EXAMPLE
from tests.physics.strips import A

BLOCK = Path(__file__).parents[1] / "services" / "md" / "scripts" / "block.in"
WIDTH = 8 * A * 3**0.5
LENGTH, STRAIN = 28 * A * 3**0.5, 2e-4
SPEEDS = {"P": 9.4663, "S": 5.4654}
"""Of the crystal, from its lattice sums."""


def bar(only: str | None, kind: str) -> dict[str, Any]:
    """Stretched or sheared along x over four periods of its slowest wave, then held for one.

    A linear ramp that lasts whole periods of a wave leaves none of it behind, nor of its overtones.
    """
    period = 2.0 * LENGTH / SPEEDS[kind]
    move = STRAIN * LENGTH
    pull = [move, 0.0] if kind == "P" else [0.0, move]
    end = {"condition": "displacement", "value": pull, "ramp": 4.0 * period}
    case: dict[str, Any] = {
        "gimpmd": 1,
        "name": "bar",
        "units": "lj",
        "domain": {"box": [[0, LENGTH], [0, WIDTH]], "periodic": [False, True]},
        "grid": {"cell": WIDTH / 8},
        "time": {"end": 5.0 * period, "md_timestep": 0.005, "md_steps": 16},
        "md": {
            "region": [[0, LENGTH / 2 if only is None else LENGTH], [0, WIDTH]],
            "input": "block.in",
            "variables": {"edge": "p"},
        },
        "continuum": {"material": {"from": "md", "cell": "bulk.in"}},
        "boundary": {"left": {"condition": "velocity", "value": [0, 0]}, "right": end},
        "output": {"interval": period / 10.0},
    }
    if only:
        case["only"] = only
    return case


def strain(run: gimpmd.Run, axis: int) -> float:
    """Slope of the displacement over the middle of each material, over the last period."""
    slopes = []
    for time in run.times[-10:]:
        bodies = [run.atoms] * (run.atoms_file is not None) + [run.points] * (
            run.points_file is not None
        )
        for body in [of(time) for of in bodies]:
            x, u = body.reference[:, 0], body.displacement[:, axis]
            inside = (x > x.min() + 5.0) & (x < x.max() - 5.0)
            slopes.append(np.polyfit(x[inside], u[inside], 1)[0])
    return float(np.mean(slopes))


@pytest.mark.long
@pytest.mark.parametrize(("kind", "most"), [("P", 3e-3), ("S", 7e-3)])
@pytest.mark.parametrize("only", ["md", "continuum", None])
def test_the_bar_is_as_stiff_as_its_crystal(
    only: str | None, kind: str, most: float, tmp_path: Path
) -> None:
    """The stress is the modulus times the strain inside, the stiffness that over the strain.

    Springs make a sheared body of atoms shorter by 0.14 at each end (0.6 % here), a stretched one
    by 0.03.
    """
    for script in (BLOCK, EXAMPLE / "bulk.in"):
        (tmp_path / script.name).write_text(script.read_text())
    case = msgspec.convert(bar(only, kind), Case)
    run = gimpmd.run(case, tmp_path / "run", scripts=tmp_path)
    assert strain(run, "PS".index(kind)) == pytest.approx(STRAIN, rel=most)

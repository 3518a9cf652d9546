"""The small case on a cluster, and the check that its bits are those of one host."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from gimpmd_deploy.results.run import Run
from tests.cases import EXAMPLE, small_case

GIMPMD = str(Path(sys.executable).parent / "gimpmd")


def write(folder: Path, end: float) -> Path:
    """The small case, with its scripts."""
    for script in EXAMPLE.glob("*.in"):
        (folder / script.name).write_text(script.read_text())
    case: dict[str, Any] = small_case()
    case["time"]["end"] = end
    path = folder / "case.yaml"
    path.write_text(yaml.safe_dump(case))
    return path


def check_same_bits(run: Run, local: Run) -> None:
    for time in (0.0, 1.0, 2.0):
        one, other = run.atoms(time), local.atoms(time)
        np.testing.assert_array_equal(one.reference, other.reference)
        np.testing.assert_array_equal(one.position, other.position)
        np.testing.assert_array_equal(one.velocity, other.velocity)
        np.testing.assert_array_equal(run.points(time).position, local.points(time).position)
    np.testing.assert_array_equal(run.energies.energy, local.energies.energy)

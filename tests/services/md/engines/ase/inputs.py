"""Inputs for ASE: the crystal of the block, with the same potential as its LAMMPS script."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec

from tests.services.md.block import A

CRYSTAL: dict[str, Any] = {
    "cell": [A, 3**0.5 * A],
    "sites": [[0.25, 0.25], [0.75, 0.75]],
    "species": ["X", "X"],
}
BLOCK: dict[str, Any] = {
    "calculator": "ase.calculators.lj:LennardJones",
    "arguments": {"sigma": 1.0, "epsilon": 1.0, "rc": 2.5},
    "crystal": CRYSTAL,
    "masses": {"X": 1.0},
}
FAST = "matscipy_lj:make"
"""The same potential, ten times as fast; see `write`."""

MODULE_FILE = "matscipy_lj.py"
MODULE = """
from matscipy.calculators.pair_potential.calculator import LennardJonesCut, PairPotential

def make():
    return PairPotential({(0, 0): LennardJonesCut(1.0, 1.0, 2.5)})
"""


def write(folder: Path, **changes: Any) -> None:
    """Write ``block.yaml``, and the module of `FAST` beside it."""
    given = BLOCK | changes
    if given["calculator"] == FAST:
        given = {key: value for key, value in given.items() if key != "arguments"}
    (folder / "block.yaml").write_bytes(
        msgspec.yaml.encode({key: value for key, value in given.items() if value is not None})
    )
    (folder / MODULE_FILE).write_text(MODULE)

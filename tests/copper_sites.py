"""Copper by embedded atoms, coupled by the sites scheme in three dimensions: cases and scripts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from gimpmd_schemas.case.form import FACES, Case
from tests.measuring import measured

A = 3.614925065810289
"""Lattice constant at zero pressure (angstrom)."""

H = 2.0 * A
"""Edge of a cell."""

SPEEDS = {"P": 43.6017, "S": 29.2033}
"""Speeds of waves along the axes (angstrom / ps)."""

POTENTIAL = """\
pair_style eam/alloy
pair_coeff * * Cu_mishin1.eam.alloy Cu
"""

CRYSTAL = f"""\
units metal
dimension 3
boundary ${{edge_x}} ${{edge_y}} ${{edge_z}}
atom_style atomic
lattice fcc {A!r} origin 0.25 0.25 0.25
region box block ${{xlo}} ${{xhi}} ${{ylo}} ${{yhi}} ${{zlo}} ${{zhi}} units box
create_box 1 box
create_atoms 1 region box
"""

CELL = f"""\
units metal
dimension 3
boundary p p p
lattice fcc {A!r}
region box block 0 1 0 1 0 1
create_box 1 box
create_atoms 1 region box
"""

HELD = {"condition": "velocity", "value": [0.0, 0.0, 0.0]}

Ends = tuple[float, float] | None


def copper_case(
    cells: tuple[int, int, int], region: tuple[Ends, Ends, Ends], end: float
) -> dict[str, Any]:
    """A body of so many cells with held faces, and a box of atoms in it, in cells.

    Along an axis without ends the body is periodic, and full of atoms.
    """
    periodic = [ends is None for ends in region]
    box = [[0.0, count * H] for count in cells]
    edges = {f"edge_{axis}": "p" if p else "s" for axis, p in zip("xyz", periodic, strict=True)}
    return {
        "gimpmd": 1,
        "name": "copper",
        "units": "metal",
        "domain": {"box": box, "periodic": periodic},
        "grid": {"cell": H},
        "time": {"end": end, "md_timestep": 0.002, "md_steps": 16},
        "md": {
            "region": [
                span if ends is None else [ends[0] * H, ends[1] * H]
                for span, ends in zip(box, region, strict=True)
            ],
            "input": "copper.in",
            "minimize": False,
            "variables": edges,
        },
        "continuum": {"material": {"from": "md", "cell": "cell.in"}, "threads": 1},
        "coupling": {"scheme": "sites"},
        "boundary": {face: HELD for k, face in enumerate(FACES) if not periodic[k // 2]},
        "output": {"interval": end, "energy_interval": 1e-6},
    }


def strained(case: dict[str, Any], size: float) -> dict[str, Any]:
    """The case at a uniform strain, which the periodic axes allow."""
    gradient = size * np.array([[1.0, 0.5, 0.3], [0.0, -0.5, 0.2], [-0.1, 0.0, 0.7]])
    gradient[:, case["domain"]["periodic"]] = 0.0
    center = [0.5 * high for _, high in case["domain"]["box"]]
    return case | {"initial": {"stretch": {"gradient": gradient.tolist(), "center": center}}}


def write_scripts(folder: Path) -> None:
    """Write the scripts that cases name."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "copper.in").write_text(CRYSTAL + POTENTIAL)
    (folder / "cell.in").write_text(CELL + POTENTIAL)


def measured_slab(folder: Path) -> Case:
    """Atoms between two planes, in a body that is periodic along y and z, as LAMMPS measures it."""
    write_scripts(folder)
    case = msgspec.convert(copper_case((16, 2, 2), ((3.3, 12.7), None, None), 0.32), Case)
    return measured(case, folder)

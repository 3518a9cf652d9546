"""The sites scheme in two dimensions with two atoms in the cell: a honeycomb of silicon."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.physics.strips import energies, run_in, strain_error

pytestmark = pytest.mark.long

A = 4.103962225870121
"""Lattice constant at zero pressure by ``gimpmd lattice`` (angstrom)."""

LATTICE = (
    f"a1 1 0 0 a2 0 {3.0**0.5!r} 0 a3 0 0 1 basis 0 0 0 basis 0.5 0.5 0 "
    f"basis 0 {1.0 / 3.0!r} 0 basis 0.5 {5.0 / 6.0!r} 0"
)

POTENTIAL = "mass 1 28.0855\npair_style sw\npair_coeff * * Si.sw Si\n"

CELL = f"""\
units metal
dimension 2
boundary p p p
lattice custom {A!r} {LATTICE}
region box block 0 1 0 1 -0.25 0.25
create_box 1 box
create_atoms 1 region box
{POTENTIAL}"""

SLAB = f"""\
units metal
dimension 2
boundary s p p
atom_style atomic
lattice custom {A!r} origin 0.25 0.25 0 {LATTICE}
region box block ${{xlo}} ${{xhi}} ${{ylo}} ${{yhi}} -0.5 0.5 units box
create_box 1 box
create_atoms 1 region box
{POTENTIAL}"""


def test_uniform_strain_is_held(tmp_path: Path) -> None:
    """What is left is of second order; measured: .98 times the square of the strain."""
    h, size = 1.5 * 3.0**0.5 * A, 1e-5
    held = {"condition": "velocity", "value": [0.0, 0.0]}
    case = {
        "gimpmd": 1,
        "name": "honeycomb",
        "units": "metal",
        "domain": {"box": [[0.0, 12 * h], [0.0, 2 * h]], "periodic": [False, True]},
        "grid": {"cell": h},
        "time": {"end": 0.32, "md_timestep": 0.002, "md_steps": 8},
        "md": {
            "region": [[2.3 * h, 9.7 * h], [0.0, 2 * h]],
            "input": "slab.in",
            "minimize": False,
        },
        "continuum": {"material": {"from": "md", "cell": "cell.in"}, "threads": 1},
        "coupling": {"scheme": "sites"},
        "boundary": {"left": held, "right": held},
        "initial": {
            "stretch": {"gradient": [[size, 0.0], [-0.4 * size, 0.0]], "center": [6 * h, h]}
        },
        "output": {"interval": 0.32, "energy_interval": 1e-6},
    }
    (tmp_path / "cell.in").write_text(CELL)
    (tmp_path / "slab.in").write_text(SLAB)
    run = run_in(case, tmp_path)
    assert strain_error(run) < 10.0 * size**2
    assert np.abs(sum(energies(run)) - 1.0).max() < 1e-6

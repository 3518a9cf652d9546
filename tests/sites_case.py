"""A small case of the sites scheme: a box of hexagonal Lennard-Jones crystal in a plate."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec

from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.resolve import make_plan
from tests.cases import changed
from tests.measuring import measured

A = 1.1132013035564605
"""Distance of neighbours at zero pressure; the crystal repeats after it along x."""

CELL = 2.0 * 3.0**0.5 * A / 1.5

SCRIPT = """\
units lj
dimension 2
boundary ${boundary_x} ${boundary_y} p
atom_style atomic
variable density equal 2.0/(1.1132013035564605^2*sqrt(3.0))
lattice hex ${density} origin 0.25 0.25 0
region box block ${xlo} ${xhi} ${ylo} ${yhi} -0.5 0.5 units box
create_box 1 box
create_atoms 1 region box
mass 1 1.0
pair_style lj/cut 2.5
pair_coeff 1 1 1.0 1.0
neighbor 0.3 bin
neigh_modify delay 0 every 5 check yes
"""

MATERIAL = {"from": "moduli", "density": 0.9317984, "lame": 27.83316, "shear": 27.83316}


def sites_case(**changes: Any) -> Case:
    """The case with dotted keys changed."""
    plain = {
        "gimpmd": 1,
        "name": "sites",
        "units": "lj",
        "domain": {"box": [[0.0, 15 * CELL], [0.0, 16 * CELL]]},
        "grid": {"cell": CELL},
        "time": {"end": 0.4, "md_timestep": 0.005, "md_steps": 16},
        "md": {
            "region": [[2.6 * CELL, 12.2 * CELL], [2.8 * CELL, 12.9 * CELL]],
            "input": "plate.in",
            "minimize": False,
            "variables": {"boundary_x": "s", "boundary_y": "s"},
        },
        "continuum": {"material": MATERIAL, "threads": 1},
        "coupling": {"scheme": "sites"},
        "output": {"interval": 0.4},
    }
    return msgspec.convert(changed(plain, changes), Case)


def measured_case(folder: Path, script: str = SCRIPT, **changes: Any) -> Case:
    """The case with all that LAMMPS measures."""
    case = sites_case(**changes)
    (folder / "plate.in").write_text(script)
    return measured(case, folder)


def sites_plan(folder: Path, **changes: Any) -> Plan:
    """The plan of the case."""
    return make_plan(measured_case(folder, **changes))

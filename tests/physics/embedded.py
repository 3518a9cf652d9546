"""A many-body potential with a close-packed plane: pairs that repel, atoms embedded by a root."""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from mpi4py import MPI
from scipy.optimize import brentq

from gimpmd_deploy.verify.strips import SCRIPT, Ground
from gimpmd_md.crystal.cell import Cell, open_cell
from gimpmd_md.crystal.moduli import measure
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.wire.answers import Repeat

CUTOFF, POINTS = 2.5, 4000

STYLE = "pair_style eam/alloy\npair_coeff * * embedded.eam X\n"
"""Commands of LAMMPS, beside the file that ``write_potential`` makes."""


CELL = """\
units lj
dimension 2
boundary p p p
lattice hex {density:.17g}
region cell block 0 1 0 1 -0.5 0.5
create_box 1 cell
create_atoms 1 region cell
mass 1 1.0
"""
"""A periodic cell of two atoms, without the potential."""


def write_potential(folder: Path) -> None:
    """``sum_i -sqrt(sum_j exp(-4 (r - 1)) w) + 0.15 sum_ij exp(-10 (r - 1)) w``, as a setfl file.

    With ``w = (1 - (r / cutoff)^2)^4`` all is smooth where neighbours leave.
    """
    r = CUTOFF / (POINTS - 1) * np.arange(POINTS)
    rho = 20.0 / (POINTS - 1) * np.arange(POINTS)
    fade = (1.0 - np.minimum(r / CUTOFF, 1.0) ** 2) ** 4
    density, pair = np.exp(-4.0 * (r - 1.0)) * fade, 0.3 * np.exp(-10.0 * (r - 1.0)) * fade
    values = np.concatenate([-np.sqrt(rho), density, r * pair])
    head = f"\n\n\n1 X\n{POINTS} {rho[1]:.16g} {POINTS} {r[1]:.16g} {CUTOFF}\n1 1.0 1.0 hex\n"
    text = head + "".join(f"{value:.16e}\n" for value in values)
    (folder / "embedded.eam").write_text(text)


def density_at_rest(folder: Path) -> float:
    """Of the crystal at zero pressure; the potential lies in the folder."""

    def pressure(density: float) -> float:
        with open_bulk(folder, density) as cell:
            return float(np.trace(cell.deform(np.eye(2))[1]))

    return float(brentq(pressure, 0.95, 1.45, xtol=1e-14))


def open_bulk(folder: Path, density: float) -> AbstractContextManager[Cell]:
    """A periodic cell of the crystal, with the potential in a folder."""
    script = folder / "bulk.in"
    style = STYLE.replace("embedded.eam", str(folder / "embedded.eam"))
    script.write_text(CELL.format(density=density) + style)
    return open_cell(str(script), "lj", MPI.COMM_SELF, folder / "log.lammps")


def ground(folder: Path, **steps: Any) -> Ground:
    """What strips of the crystal are cut from; writes the potential and the cell into a folder.

    A cell of the grid is two periods of the lattice, as in `tests.physics.strips`.
    """
    write_potential(folder)
    density = density_at_rest(folder)
    with open_bulk(folder, density) as cell:
        found = measure(cell)
    (folder / "cell.in").write_text(CELL.format(density=density) + STYLE)
    spacing = (2.0 / (3.0**0.5 * density)) ** 0.5
    edges, h = (spacing, 3.0**0.5 * spacing), 2.0 * 3.0**0.5 * spacing
    case = {
        "gimpmd": 1,
        "name": "strips",
        "units": "lj",
        "domain": {"box": [[0.0, 1.0], [0.0, 1.0]]},
        "grid": {"cell": h},
        "time": {"end": 1.0} | steps,
        "md": {
            "region": [[0.0, 1.0], [0.0, 1.0]],
            "input": SCRIPT,
            "files": ["embedded.eam"],
            "minimize": False,
        },
        "continuum": {"material": msgspec.to_builtins(found)},
        "coupling": {"scheme": "sites"},
        "output": {"interval": 1.0},
    }
    repeat = Repeat(low=(0.0, 0.0), size=edges, period=edges)
    return Ground(msgspec.convert(case, Case), "cell.in", repeat, 0, h, (2,))

"""Strips of the Lennard-Jones crystal: those of ``gimpmd verify interface``, in this study's units.

The strip runs as a user's case does, by the command, in separate processes. Lengths are counted
in cells; the cell is two periods of the lattice, as in the study behind docs/theory.md.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from gimpmd_deploy.results.run import Run
from gimpmd_deploy.verify.crossing import crossing, energies
from gimpmd_deploy.verify.strips import SCRIPT, Ground, Wave
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import dump_case
from gimpmd_schemas.wire.answers import Repeat

A = 1.1132013035564605
H = float(2.0 * np.sqrt(3.0) * A)
MATERIAL = {"from": "moduli", "density": 0.9317984, "lame": 27.83316, "shear": 27.83316}
OFTEN = 1e-6
"""Time between energies: at all common times of the levels."""
CELL = Path(__file__).parent / "strip" / "cell.in"
LONGEST = 1800.0
"""Seconds after which a run counts as hung: a hundred thousand coupling steps take minutes."""

__all__ = ["OFTEN", "Run", "Wave", "crossing", "energies"]


def ground(md_steps: int = 40, md_timestep: float = 0.002, **changes: Any) -> Ground:
    """What strips are cut from; ``changes`` are parts of the case, such as ``coupling``."""
    case = {
        "gimpmd": 1,
        "name": "strips",
        "units": "lj",
        "domain": {"box": [[0.0, 1.0], [0.0, 1.0]]},
        "grid": {"cell": H},
        "time": {"end": 1.0, "md_timestep": md_timestep, "md_steps": md_steps},
        "md": {"region": [[0.0, 1.0], [0.0, 1.0]], "input": SCRIPT, "minimize": False},
        "continuum": {"material": MATERIAL},
        "output": {"interval": 1.0, "energy_interval": OFTEN},
        **changes,
    }
    edges = (A, float(np.sqrt(3.0) * A))
    repeat = Repeat(low=(0.0, 0.0), size=edges, period=edges)
    return Ground(msgspec.convert(case, Case), CELL.name, repeat, 0, H, (2,))


def strip_case(
    wavelength: float,
    travel: Literal["into", "out"],
    polarization: Literal["P", "S"] = "P",
    **changes: Any,
) -> dict[str, Any]:
    """Case, as plain values, of a packet that crosses the interface; ``wavelength`` in cells."""
    return plain(ground(**changes).strip(Wave(wavelength, polarization), travel))


def plain(case: Case) -> dict[str, Any]:
    """A case as values that can be changed."""
    values: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(case))
    return values


def broadband_case(end: float, **changes: Any) -> dict[str, Any]:
    """Case of a short strip, atoms between two continua, full of waves of 4 to 10 cells."""
    case = strip_case(20.0, "into", **changes)
    side, middle = 8, 14
    length = (2 * side + middle) * H
    case["name"] = "broadband"
    case["domain"]["box"] = [[0.0, length], case["domain"]["box"][1]]
    case["md"]["region"] = [[side * H, (side + middle) * H], case["md"]["region"][1]]
    case["time"]["end"] = end
    case["initial"]["packets"] = [
        {
            "center": place * length,
            "wavelength": wavelength * H,
            "cycles": 1.0,
            "strain": 2e-4,
            "direction": direction,
            "polarization": polarization,
        }
        for polarization in "PS"
        for place, wavelength, direction in (
            (0.1, 6.0, 1),
            (0.15, 10.0, -1),
            (0.5, 6.0, -1),
            (0.45, 10.0, 1),
            (0.9, 4.0, 1),
            (0.55, 4.0, -1),
        )
    ]
    case["output"] = {"interval": end, "energy_interval": OFTEN}
    return case


def two_ranks(case: dict[str, Any]) -> dict[str, Any]:
    """The case with its atoms on two MPI ranks."""
    case["md"] |= {"ranks": 2, "patches": [2, 1]}
    return case


def strain_error(run: Run) -> float:
    """Largest departure of the points' strains at the end from the uniform one of the start."""
    G = np.array(run.case.initial.stretch.gradient)
    exact = [G[0, 0], G[1, 1], G[0, 1] + G[1, 0]]
    return float(np.abs(run.points().fields["strain"] - exact).max())


def run_case(plain_case: dict[str, Any], folder: Path, *options: str) -> Run:
    """Run a case by the command."""
    case = msgspec.convert(plain_case, Case)
    folder.mkdir(parents=True, exist_ok=True)
    for script in CELL.parent.glob("*.in"):
        (folder / script.name).write_text(script.read_text())
    (folder / SCRIPT).write_text(ground().lammps(case))
    dump_case(case, folder / "case.yaml")
    return run_folder(folder, *options)


def run_in(plain_case: dict[str, Any], folder: Path, *options: str) -> Run:
    """Run a case by the command, in a folder that holds its scripts."""
    dump_case(msgspec.convert(plain_case, Case), folder / "case.yaml")
    return run_folder(folder, *options)


def run_folder(folder: Path, *options: str) -> Run:
    """Run the ``case.yaml`` of a folder by the command."""
    out = folder / "run"
    command = [sys.executable, "-m", "gimpmd_deploy.cli.app", "run", str(folder / "case.yaml")]
    done = subprocess.run(
        [*command, "--out", str(out), "--no-figures", *options],
        capture_output=True,
        text=True,
        timeout=LONGEST,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return Run(out)

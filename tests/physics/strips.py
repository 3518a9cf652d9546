"""Plane wave packets on a strip: continuum on the left, atoms on the right, periodic across.

The strip runs as a user's case does, by the command, in separate processes. Lengths are counted
in cells; the cell is two periods of the lattice, as in the study behind docs/theory.md.
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import h5py
import numpy as np
import yaml

A = 1.1132013035564605
H = 2.0 * np.sqrt(3.0) * A
MATERIAL = {"from": "case", "density": 0.9317984, "lame": 27.83316, "shear": 27.83316}
SPEED = {"P": 9.46633, "S": 5.46539}
SCRIPT = Path(__file__).parent / "strip" / "strip.in"


@dataclass(frozen=True)
class Energies:
    """Energy on both sides of the interface over time, as fractions of the packet's."""

    time: np.ndarray
    continuum: np.ndarray
    md: np.ndarray


def strip_case(
    wavelength: float,
    travel: Literal["into", "out"],
    polarization: Literal["P", "S"] = "P",
    only: str | None = None,
    md_steps: int = 40,
) -> dict[str, object]:
    """Case of a packet that crosses the interface; ``wavelength`` in cells.

    The packet is two wavelengths wide at half its height, so that three wavelengths to either
    side hold all but 4e-6 of its energy. It starts three wavelengths before the interface and
    ends as far behind.
    """
    reach = 3.0 * wavelength
    cells = int(np.ceil(2.0 * reach + 8.0))
    # the grid is a little slow: time for eight cells more
    steps = int(np.ceil((2.0 * reach + 8.0) * H / SPEED[polarization] / 0.08))
    interface = cells * H
    length = 2 * cells * H
    start = interface + (-1.0 if travel == "into" else 1.0) * reach * H
    return {
        "gimpmd": 1,
        "name": f"strip-{travel}-{wavelength:g}{polarization}",
        "units": "lj",
        "domain": {
            "box": [[0.0, float(length)], [0.0, float(2.0 * H)]],
            "periodic": [False, True],
        },
        "grid": {"cell": float(H)},
        "time": {
            "end": 0.08 * steps,
            "md_timestep": 0.08 / md_steps,
            "md_steps": md_steps,
        },
        "md": {
            "region": [[float(interface), float(length)], [0.0, float(2.0 * H)]],
            "input": SCRIPT.name,
            "minimize": False,
        },
        "continuum": {"material": MATERIAL},
        "boundary": {
            "left": {"condition": "velocity", "value": [0.0, 0.0]},
            "right": {"condition": "velocity", "value": [0.0, 0.0]},
        },
        "initial": {
            "packets": [
                {
                    "center": float(start),
                    "wavelength": float(wavelength * H),
                    "strain": 2e-4,
                    "direction": 1 if travel == "into" else -1,
                    "polarization": polarization,
                }
            ]
        },
        "output": {"interval": 0.08 * steps},
    }


def broadband_case(end: float, md_steps: int = 40, md_timestep: float = 0.002) -> dict[str, object]:
    """Case of a short strip, atoms between two continua, full of waves of 4 to 10 cells."""
    case = strip_case(20.0, "into", md_steps=md_steps)
    side, middle = 8, 14
    length = (2 * side + middle) * H
    case["name"] = "broadband"
    case["domain"]["box"][0] = [0.0, float(length)]
    case["md"]["region"][0] = [float(side * H), float((side + middle) * H)]
    case["time"] = {"end": end, "md_timestep": md_timestep, "md_steps": md_steps}
    case["initial"]["packets"] = [
        {
            "center": float(place * length),
            "wavelength": float(wavelength * H),
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
    case["output"] = {"interval": end}
    return case


def run_case(case: dict[str, object], folder: Path, *options: str) -> Path:
    """Run a case by the command; returns the run folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / SCRIPT.name).write_text(SCRIPT.read_text())
    (folder / "case.yaml").write_text(yaml.safe_dump(case))
    out = folder / "run"
    command = [sys.executable, "-m", "gimpmd_deploy.cli", "run", str(folder / "case.yaml")]
    done = subprocess.run(
        [*command, "--out", str(out), *options],
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return out


def energies(run: Path) -> Energies:
    """Kinetic and potential energy of both sides over that of the start."""
    with h5py.File(run / "run.h5") as file:
        series = file["series"]
        sides = {
            role: series[f"{role}/kinetic"][:] + series[f"{role}/potential"][:]
            for role in ("continuum", "md")
        }
        time = series["time"][:]
    total = sides["continuum"][0] + sides["md"][0]
    return Energies(time, sides["continuum"] / total, sides["md"] / total)


def continuum_split(run: Path, interface: float) -> tuple[float, float]:
    """Energy left and right of the interface at the end of a run of the continuum alone.

    Both as fractions of the energy at the start.
    """
    with h5py.File(run / "fields" / "points.vtkhdf") as file:
        root = file["VTKHDF"]
        data, count = root["PointData"], int(root["NumberOfPoints"][0])
        x = data["reference"][:count, 0]
        area = data["size"][:count].prod(axis=1)
        sums = []
        for rows in (slice(0, count), slice(-count, None)):
            kinetic = 0.5 * MATERIAL["density"] * (data["velocity"][rows] ** 2).sum(axis=1)
            strain = 0.5 * (data["stress"][rows] * data["strain"][rows]).sum(axis=1)
            sums.append(area * (kinetic + strain))
    left = x < interface
    return sums[1][left].sum() / sums[0].sum(), sums[1][~left].sum() / sums[0].sum()

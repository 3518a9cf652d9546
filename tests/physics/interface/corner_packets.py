"""Short waves that run into a corner of two planes: what the absorber leaves of them.

``python -m tests.physics.interface.corner_packets [LENGTH ...]`` prints the table of
docs/scheme-fs.md for hexagonal Lennard-Jones, lengths in cells; ``--metal`` that of copper.
A square or cube of atoms starts with velocities in its middle: a wave along the diagonal with a
Gaussian envelope. It splits into two packets that run into opposite corners.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tests.copper_sites import COPPER, copper_case, write_scripts
from tests.physics.strips import H, Run, broadband_case, run_in
from tests.sites_case import SCRIPT

ACROSS = 2.0
"""Standard deviation of the envelope across the diagonal, in cells."""

CYCLES = 2.0
"""Full width of the envelope at half maximum along the diagonal, in wavelengths."""

SPEED = 1e-3
"""Largest speed of an atom, over the speed of the wave."""

LATE = 0.95
"""Energies of atoms are means from this share of the run on."""


@dataclass(frozen=True)
class Body:
    """Atoms with corners.

    Attributes
    ----------
    case : without absorber and end.
    cell : edge of a cell (length).
    middle : centre of the region.
    speeds : of waves along its diagonal (length / time).
    motions : directions of motion, by kind of wave; that of P waves is their way.
    """

    case: dict[str, Any]
    cell: float
    middle: np.ndarray
    speeds: dict[str, float]
    motions: dict[str, np.ndarray]

    def until(self, kind: str) -> float:
        """Time in which the packet runs into the corner, and what it becomes comes back."""
        region = np.array(self.case["md"]["region"])
        half = 0.5 * float(np.linalg.norm(region[:, 1] - region[:, 0]))
        return half / self.speeds[kind] + half / self.speeds["S"]


def plane(cells: float = 20.0) -> Body:
    """A square of Lennard-Jones atoms in a plate; its crystal is isotropic for long waves."""
    case = broadband_case(1.0, md_steps=16, md_timestep=0.005, coupling={"scheme": "sites"})
    low, high = 6.3, 6.3 + cells
    count = math.ceil(high) + 6
    case["domain"] = {"box": [[0.0, count * H]] * 2, "periodic": [False, False]}
    case["md"] |= {
        "region": [[low * H, high * H]] * 2,
        "input": "atoms.in",
        "after": "start.in",
        "variables": {"boundary_x": "s", "boundary_y": "s"},
        "files": [],
    }
    along = np.full(2, 0.5**0.5)
    return Body(
        case,
        H,
        np.full(2, 0.5 * (low + high) * H),
        {"P": 9.4660, "S": 5.4653},
        {"P": along, "S": np.array([-along[1], along[0]])},
    )


def space(cells: float = 12.0) -> Body:
    """A cube of copper; along [111] P waves move along their way, and S waves across."""
    low, high = 4.3, 4.3 + cells
    count = math.ceil(high) + 4
    case = copper_case((count,) * 3, ((low, high),) * 3, 1.0)
    case["md"]["after"] = "start.in"
    along = np.full(3, 3.0**-0.5)
    return Body(
        case,
        COPPER.cell,
        np.full(3, 0.5 * (low + high) * COPPER.cell),
        {"P": 52.01, "S": 21.43},
        {"P": along, "S": np.array([1.0, -1.0, 0.0]) * 0.5**0.5},
    )


def commands(body: Body, kind: str, length: float) -> str:
    """Set the velocities in LAMMPS; ``length`` of the wave in cells."""
    dim, h = len(body.middle), body.cell
    along, motion = body.motions["P"], body.motions[kind]
    axes = "xyz"[:dim]
    s = "+".join(
        f"({axis}-{middle!r})*{part!r}"
        for axis, middle, part in zip(axes, body.middle.tolist(), along.tolist(), strict=True)
    )
    square = "+".join(
        f"({axis}-{middle!r})^2" for axis, middle in zip(axes, body.middle.tolist(), strict=True)
    )
    wide = CYCLES * length * h / math.sqrt(8.0 * math.log(2.0))
    speed = SPEED * body.speeds[kind]
    lines = [
        f"variable s atom {s}",
        f"variable r atom sqrt(abs({square}-v_s*v_s))",
        f"variable start atom {speed!r}*cos({2.0 * math.pi / (length * h)!r}*v_s)"
        f"*exp(-0.5*(v_s/{wide!r})^2-0.5*(v_r/{ACROSS * h!r})^2)",
        *(
            f"variable start_{axis} atom {part!r}*v_start"
            for axis, part in zip(axes, motion.tolist(), strict=True)
        ),
    ]
    names = " ".join([f"v_start_{axis}" for axis in axes] + ["NULL"] * (3 - dim))
    return "\n".join([*lines, f"velocity gimpmd_free set {names} sum no units box"]) + "\n"


def run_packet(
    body: Body, kind: str, length: float, absorber: dict[str, Any] | None, folder: Path
) -> Run:
    """Run a packet by the command, in a folder."""
    write_scripts(folder)
    (folder / "atoms.in").write_text(SCRIPT)
    (folder / "start.in").write_text(commands(body, kind, length))
    case, times = body.case, body.case["time"]
    step = times["md_timestep"] * times["md_steps"]
    end = step * math.ceil(body.until(kind) / step)
    case = case | {
        "time": times | {"end": end},
        "output": {"interval": end, "energy_interval": step},
        "coupling": case["coupling"] | {"absorber": absorber},
        "initial": {},
    }
    return run_in(case, folder)


def left(run: Run) -> float:
    """Twice the kinetic energy of the atoms at the end, over the energy of the start."""
    time, kinetic = run.energies.time, run.energies.md.kinetic
    late = time >= LATE * time[-1]
    return float(2.0 * kinetic[late].mean() / kinetic[0])


def row(body: Body, kind: str, length: float) -> str:
    """A row of the table: what is left among the atoms, and what was taken."""
    with tempfile.TemporaryDirectory() as place:
        runs = [
            run_packet(body, kind, length, absorber, Path(place) / str(k))
            for k, absorber in enumerate((None, {}))
        ]
        shares = [f"{left(run):.4f}" for run in runs]
        energies = runs[1].energies
        taken = energies.dissipated[-1] / energies.md.kinetic[0]
        balance = "; ".join(
            f"{np.abs(e.energy + e.dissipated - e.energy[0]).max() / e.md.kinetic[0]:.1e}"
            for e in (run.energies for run in runs)
        )
    return f"| {kind} {length:g} h | {shares[0]} | {shares[1]} | {taken:.4f} | {balance} |"


def main() -> None:
    """Print what is left of packets, one row after another."""
    parser = argparse.ArgumentParser(prog="python -m tests.physics.interface.corner_packets")
    parser.add_argument("lengths", type=float, nargs="*", help="cells")
    parser.add_argument("--kind", choices=("P", "S"), action="append")
    parser.add_argument("--metal", action="store_true", help="a cube of copper")
    words = parser.parse_args()
    body = space() if words.metal else plane()
    print("| wave | left without | left with | taken | energy balance, without; with |")
    print("|---|---|---|---|---|", flush=True)
    for kind in words.kind or "PS":
        for length in words.lengths or ((1.5, 2.0, 3.0) if words.metal else (0.867, 2, 3, 3.5, 4)):
            print(row(body, kind, length), flush=True)


if __name__ == "__main__":
    main()

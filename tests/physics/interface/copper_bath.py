"""A bath in copper: the temperature of atoms between two planes, by their distance from them.

``python -m tests.physics.interface.copper_bath`` prints the table of docs/scheme-fs.md.
"""

from __future__ import annotations

import argparse
import tempfile
from itertools import pairwise
from pathlib import Path

import numpy as np

from gimpmd_schemas.arrays import Floats
from gimpmd_schemas.mechanics.units import UNITS
from tests.copper_sites import copper_case, write_scripts
from tests.physics.interface.copper_heat import HEAT, MD_STEP, SAMPLE
from tests.physics.strips import Run, run_in

BODY = (20, 2, 2), ((2.6, 17.4), None, None)
"""Cells, and the place of the atoms: the bands of both planes leave a part in the middle alone."""

DEPTHS = (0.0, 1.0, 2.5, 4.0, 5.5, np.inf)
"""Ends of layers, in cells from the nearest plane."""

EVERY = 4
"""Coupling steps between the times at which velocities are read."""

SETTLED = 5.0
"""Picoseconds that are left out."""

BLOCKS = 20
"""Means whose spread gives the standard error; each is much longer than a vibration."""


def run_bath(temperature: float, end: float, folder: Path) -> Run:
    """Run atoms that start at the temperature of the bath, by the command, in a folder."""
    write_scripts(folder)
    (folder / "heat.in").write_text(HEAT.format(kinetic=2.0 * temperature))
    interval = EVERY * SAMPLE
    case = copper_case(*BODY, interval * round(end / interval))
    case["boundary"] = {}
    case["md"]["after"] = "heat.in"
    case["coupling"]["absorber"] = {"temperature": temperature}
    case["time"] |= {"md_timestep": MD_STEP}
    case["output"] = {"interval": interval, "energy_interval": SAMPLE}
    return run_in(case, folder)


def by_depth(run: Run) -> tuple[Floats, list[int]]:
    """Kinetic temperatures by time and layer, and how many atoms each layer has."""
    [interface] = run.plan.coupled.interfaces
    units, layers = UNITS[run.plan.units], len(DEPTHS) - 1
    squares, counts = [], []
    for time in (t for t in run.times if t >= SETTLED):
        atoms = run.atoms(time)
        atoms = atoms.where(interface.free(atoms.reference))
        layer = np.digitize(interface.depth(atoms.reference) / run.case.grid.cell, DEPTHS) - 1
        counts = np.bincount(layer, minlength=layers).tolist()
        squares.append(np.bincount(layer, (atoms.velocity**2).sum(axis=1), layers))
    mass = run.energies.md.mass[0] / sum(counts)
    kelvin = units.energy_to_mechanical(units.boltz)
    return mass * np.array(squares) / (3.0 * kelvin * np.array(counts)), counts


def mean(values: Floats) -> tuple[float, float]:
    """Mean over time, and its standard error from means of blocks."""
    blocks = np.array([part.mean() for part in np.array_split(values, BLOCKS)])
    return float(values.mean()), float(blocks.std(ddof=1) / np.sqrt(BLOCKS))


def change(run: Run) -> float:
    """Largest change of the energy and what was dissipated, over the energy of the start."""
    energies = run.energies
    kept = energies.energy + energies.dissipated
    return float(np.abs(kept / kept[0] - 1.0).max())


def main() -> None:
    """Print the temperature by depth, over that of the bath, and how the energy balances."""
    parser = argparse.ArgumentParser(prog="python -m tests.physics.interface.copper_bath")
    parser.add_argument("--temperature", type=float, default=300.0, help="kelvin")
    parser.add_argument("--end", type=float, default=100.0, help="picoseconds")
    words = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        run = run_bath(words.temperature, words.end, Path(place))
        found, counts = by_depth(run)
    print("| depth (h) | atoms | T over that of the bath |\n|---|---|---|")
    for k, (low, high) in enumerate(pairwise(DEPTHS)):
        value, error = mean(found[:, k] / words.temperature)
        print(f"| {low:g} to {high:g} | {counts[k]} | {value:.4f} +- {error:.4f} |")
    whole = found @ np.array(counts) / sum(counts) / words.temperature
    value, error = mean(whole)
    # canonical: var T = 2 T^2 / (3 n)
    share = whole.std() * np.sqrt(1.5 * sum(counts))
    print(f"| all | {sum(counts)} | {value:.4f} +- {error:.4f}; fluctuation {share:.3f} |")
    print(f"energy + dissipated: largest change {change(run):.1e} of that of the start")


if __name__ == "__main__":
    main()

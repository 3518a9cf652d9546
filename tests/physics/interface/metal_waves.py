"""Crystals of many-body potentials, coupled by the sites scheme in space.

``python -m tests.physics.interface.metal_waves [NAME ...]`` prints the table of
docs/scheme-fs.md: uniform strains that are held, and waves of 8 cells that leave the atoms.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Literal

from tests.copper_sites import (
    ALUMINIUM,
    ALUMINIUM_FS,
    ALUMINIUM_JEA,
    COPPER,
    COPPER_FUNCFL,
    COPPER_SNAP,
    IRON,
    SILICON,
    SILICON_SOFT,
    SILICON_TERSOFF,
    TUNGSTEN_FINE,
    Metal,
    copper_case,
    strained,
    wave_case,
)
from tests.physics.test_sites_in_space import BODIES, crossed, run_case, share, strain_errors

METALS = {
    "Cu": COPPER,
    "Cu-funcfl": COPPER_FUNCFL,
    "Cu-snap": COPPER_SNAP,
    "Al": ALUMINIUM_JEA,
    "Al-zhou": ALUMINIUM,
    "Al-fs": ALUMINIUM_FS,
    "Fe": IRON,
    "W": TUNGSTEN_FINE,
    "Si": SILICON,
    "Si-tersoff": SILICON_TERSOFF,
    "Si-soft": SILICON_SOFT,
}
"""With faces {100}."""

SIZE, END = 1e-5, 0.64
"""Strain, and how long it is held (ps)."""

SHAPES = ("slab", "column")

WIDE = 1.5
"""Lattice constants that a cell must have for the column to have room for free atoms."""


def strain_error(name: str, metal: Metal, folder: Path) -> float:
    """Largest error of a strain that a body holds, over the square of the strain."""
    case = strained(copper_case(*BODIES[name], END, metal), SIZE)
    return float(strain_errors(run_case(case, folder, metal)).max() / SIZE**2)


def held(metal: Metal, folder: Path, _: float) -> str:
    """How well a slab and a column hold a strain; the column must be wide enough for its ghosts."""
    names = SHAPES if metal.periods >= WIDE else SHAPES[:1]
    return "; ".join(f"{strain_error(name, metal, folder / name):.2g}" for name in names)


def wave(polarization: Literal["P", "S"], metal: Metal, folder: Path, strain: float) -> str:
    """What comes back, what passes, how the plane cuts its cell, and how the energy balances."""
    run = run_case(wave_case(polarization, metal=metal, strain=strain), folder, metal)
    reflected, transmitted = crossed(run)
    balance = run.energies.largest_imbalance()
    return f"{reflected:.4f}, {transmitted:.4f}; {share(run):.2f}; {balance:.1e}"


PARTS: dict[str, tuple[str, Callable[[Metal, Path, float], str]]] = {
    "held": (f"error of a strain of {SIZE:g} over its square: slab; column", held),
    "P": ("P of 8 h: R, T; f; energy", partial(wave, "P")),
    "S": ("S of 8 h: R, T; f; energy", partial(wave, "S")),
}


def row(name: str, parts: Sequence[str], strain: float) -> str:
    """A row of the table."""
    metal = METALS[name]
    cells = [name, f"{metal.periods:g} a"]
    with tempfile.TemporaryDirectory() as place:
        cells += [PARTS[part][1](metal, Path(place) / part, strain) for part in parts]
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Print the rows, one after another."""
    parser = argparse.ArgumentParser(prog="python -m tests.physics.interface.metal_waves")
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(METALS))
    parser.add_argument("--part", choices=PARTS, action="append", help="default: all")
    parser.add_argument("--strain", type=float, default=2e-4, help="amplitude of waves")
    words = parser.parse_args()
    names, parts = words.names or list(METALS), words.part or list(PARTS)
    if unknown := [name for name in names if name not in METALS]:
        parser.error(f"no such crystal: {', '.join(unknown)}; there are {', '.join(METALS)}")
    print(f"| crystal | h | {' | '.join(PARTS[part][0] for part in parts)} |")
    print(f"|---|---|{'---|' * len(parts)}", flush=True)
    for name in names:
        print(row(name, parts, words.strain), flush=True)


if __name__ == "__main__":
    main()

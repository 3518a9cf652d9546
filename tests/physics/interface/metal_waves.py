"""Crystals of many-body potentials, coupled by the sites scheme in space.

``python -m tests.physics.interface.metal_waves [NAME ...]`` prints the table of
docs/scheme-fs.md: uniform strains that are held, and waves of 8 cells that leave the atoms.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from gimpmd_deploy.verify.crossing import crossing
from tests.copper_sites import (
    ALUMINIUM,
    ALUMINIUM_FS,
    COPPER,
    COPPER_FUNCFL,
    COPPER_SNAP,
    IRON,
    SILICON,
    SILICON_TERSOFF,
    TUNGSTEN,
    Metal,
    copper_case,
    strained,
    wave_case,
)
from tests.physics.test_sites_in_space import BODIES, run_case, share, strain_errors

METALS = {
    "Cu": COPPER,
    "Cu-funcfl": COPPER_FUNCFL,
    "Cu-snap": COPPER_SNAP,
    "Al": ALUMINIUM,
    "Al-fs": ALUMINIUM_FS,
    "Fe": IRON,
    "W": TUNGSTEN,
    "Si": SILICON,
    "Si-tersoff": SILICON_TERSOFF,
}
"""With faces {100}."""

SIZE, END = 1e-5, 0.64
"""Strain, and how long it is held (ps)."""


def strain_error(name: str, metal: Metal, folder: Path) -> float:
    """Largest error of a strain that a body holds, over the square of the strain."""
    case = strained(copper_case(*BODIES[name], END, metal), SIZE)
    return float(strain_errors(run_case(case, folder, metal)).max() / SIZE**2)


def row(name: str) -> str:
    """A row of the table."""
    metal = METALS[name]
    with tempfile.TemporaryDirectory() as place:
        held = "; ".join(
            f"{strain_error(body, metal, Path(place) / body):.3g}" for body in ("slab", "column")
        )
        runs = [run_case(wave_case(kind, metal=metal), Path(place) / kind, metal) for kind in "PS"]
        crossed = ("{:.4f}, {:.4f}".format(*crossing(run)) for run in runs)
        balance = "; ".join(f"{run.energies.largest_imbalance():.1e}" for run in runs)
        cells = (name, f"{metal.periods:g} a", held, f"{share(runs[0]):.3g}", *crossed, balance)
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Print the rows, one after another."""
    parser = argparse.ArgumentParser(prog="python -m tests.physics.interface.metal_waves")
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(METALS))
    names = parser.parse_args().names or list(METALS)
    if unknown := [name for name in names if name not in METALS]:
        parser.error(f"no such crystal: {', '.join(unknown)}; there are {', '.join(METALS)}")
    print("| crystal | h | strain held: slab; column | f | P: R, T | S: R, T | energy: P; S |")
    print("|---|---|---|---|---|---|---|", flush=True)
    for name in names:
        print(row(name), flush=True)


if __name__ == "__main__":
    main()

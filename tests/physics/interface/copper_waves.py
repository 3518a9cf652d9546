"""Waves in copper across the planes of the sites scheme, without absorber and with it.

``python -m tests.physics.interface.copper_waves [LENGTH ...]`` prints the table of
docs/verification.md, lengths in cells.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any, Literal

from tests.copper_sites import wave_case, write_scripts
from tests.physics.strips import Run, crossing, run_in

Way = Literal["out", "into"]

LENGTHS = (1.5, 2.0, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0, 12.0, 20.0)
"""In cells; the first is six layers of atoms."""

CARRIED = 6.0
"""Shortest waves that are sent into the atoms: those from which on the grid carries them."""

DEEPER = 8.0
"""Cells by which packets start farther from the planes, so that none of them starts in the band."""

SETTINGS: tuple[dict[str, Any] | None, ...] = (None, {})
"""Without absorber, and with it."""


def run_wave(
    polarization: str, length: float, way: Way, absorber: dict[str, Any] | None, folder: Path
) -> Run:
    """Run a packet by the command, in a folder."""
    case = wave_case(polarization, length, DEEPER, way)
    case["coupling"]["absorber"] = absorber
    write_scripts(folder)
    return run_in(case, folder)


def row(polarization: str, length: float, way: Way) -> str:
    """A row of the table: what comes back, passes, and is taken, and how the energy balances."""
    shares, energies = [], []
    with tempfile.TemporaryDirectory() as place:
        for k, absorber in enumerate(SETTINGS):
            run = run_wave(polarization, length, way, absorber, Path(place) / str(k))
            shares.append("{:.4f}, {:.4f}".format(*crossing(run)))
            energies.append(run.energies)
    taken = energies[1].dissipated[-1] / energies[1].energy[0]
    balance = "; ".join(f"{one.largest_imbalance():.1e}" for one in energies)
    cells = (f"{polarization} {length:g} h", way, *shares, f"{taken:.4f}", balance)
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Print R and T of packets, one row after another."""
    parser = argparse.ArgumentParser(prog="python -m tests.physics.interface.copper_waves")
    parser.add_argument("lengths", type=float, nargs="*")
    parser.add_argument("--kind", choices=("P", "S"), action="append")
    parser.add_argument("--way", choices=("out", "into"), action="append")
    words = parser.parse_args()
    ways: list[Way] = words.way or ["out", "into"]
    print("| wave | way | without: R, T | with: R, T | taken | energy balance, without; with |")
    print("|---|---|---|---|---|---|", flush=True)
    for way in ways:
        for kind in words.kind or "PS":
            for length in words.lengths or LENGTHS:
                if way == "out" or length >= CARRIED:
                    print(row(kind, length, way), flush=True)


if __name__ == "__main__":
    main()

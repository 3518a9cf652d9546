"""Reflection and transmission over wavelength: all schemes, the grid and the atoms alone.

    python -m tests.physics.interface.table [WORD ...]

prints a Markdown table for docs/verification.md: R, T. Words choose among velocity, force and
paper, and among wavelengths in cells.
"""

from __future__ import annotations

import sys
from typing import Any

from tests.physics.interface.packets import STEPS, WAYS
from tests.physics.interface.running import run_all
from tests.physics.interface.schemes import coupled
from tests.physics.strips import Wave, crossing, ground, plain

LENGTHS = (4.0, 6.0, 8.0, 12.0, 20.0, 40.0)
SCHEMES = ("velocity", "force", "paper")


def rows(schemes: list[str], lengths: list[float]) -> list[str]:
    """Lines of the table."""
    cases: list[tuple[Any, dict[str, Any], tuple[str, ...]]] = []
    for length in sorted(lengths, reverse=True):
        for kind in ("P", "S"):
            wave = Wave(length, kind)
            for way in WAYS:
                case = plain(ground(**STEPS).strip(wave, way))
                if way == "into":
                    for side in ("continuum", "md"):
                        cases.append(((wave, side), case, ("--only", side)))
                for scheme in schemes:
                    own = plain(ground(**STEPS).strip(wave, way))
                    cases.append(((wave, scheme, way), coupled(own, scheme), ()))  # type: ignore[arg-type]
    shares = {key: crossing(run) for key, run in run_all(cases).items()}
    columns = [f"{scheme} {way}" for scheme in schemes for way in WAYS]
    lines = [
        f"| wave | grid alone | atoms alone | {' | '.join(columns)} |",
        f"|---|{'---|' * (len(columns) + 2)}",
    ]
    for kind in ("P", "S"):
        for length in lengths:
            wave = Wave(length, kind)
            keys = [(wave, "continuum"), (wave, "md")]
            keys += [(wave, scheme, way) for scheme in schemes for way in WAYS]  # type: ignore[misc]
            cells = [f"{shares[key][0]:.4f}, {shares[key][1]:.4f}" for key in keys]
            lines.append(f"| {kind} {length:g} h | {' | '.join(cells)} |")
    return lines


if __name__ == "__main__":
    words = sys.argv[1:]
    chosen = [word for word in words if word in SCHEMES] or list(SCHEMES)
    numbers = [float(word) for word in words if word not in SCHEMES] or list(LENGTHS)
    print("\n".join(rows(chosen, numbers)))

